// The limits of the wire contract, except those of settings: a setting's range and default are declared at
// its field in render.proto. Units are in the names. Ranges are inclusive.
#pragma once

#include <cstdint>

namespace candela::v1 {

// Sizes on the wire.
inline constexpr uint64_t kMaxBandBytes = 2u << 20;          // pixels in one band
inline constexpr uint64_t kMaxMessageBytes = 4u << 20;       // one gRPC message, either way
inline constexpr uint32_t kMaxDimension = 16384;             // width or height of a frame, in pixels
inline constexpr uint64_t kDefaultMaxFrameBytes = 1u << 29;  // one frame, unless the server says otherwise

inline constexpr uint32_t kMaxSessionNameBytes = 64;
inline constexpr uint32_t kMaxTokenBytes = 1024;
inline constexpr uint32_t kMaxPendingChanges = 16;  // SettingsChanges for frames that have not come yet

inline constexpr uint64_t kMaxTableBytes = 65 * 65 * 65 * 6;  // values of the largest colour table

// Memory that client and server share; docs/transport.md.
inline constexpr uint64_t kMemoryTicketBytes = 16;
inline constexpr uint64_t kMemoryAlignment = 64;       // of offsets into a region, bytes
inline constexpr uint64_t kMaxRegionBytes = 1u << 31;  // one region
inline constexpr uint64_t kMaxMemoryReplyBytes = 256;  // of the server at the .memory socket
inline constexpr char kMemorySuffix[] = ".memory";     // of that socket, after the path of gRPC's

template <typename T>
struct Range {
  T min;
  T max;
};

// Ranges that cannot be declared at a field: those that involve two settings, those of tables and of image
// sizes, and those of a frame's previous exposure.
inline constexpr double kLeastPercentileRange = 1e-6;            // percent; from low to high
inline constexpr Range<double> kExposureLimit{0x1p-40, 0x1p40};  // factor
inline constexpr double kNothingMetered = -2.4739311883324124;   // EV; log2 0.18, the mean of nothing
inline constexpr Range<double> kElapsedSeconds{0.0, 1e9};        // media time
inline constexpr Range<uint32_t> kTableSize{2, 65};              // points a side
inline constexpr Range<double> kTableEnd{1.0, 65504.0};          // exposed light
inline constexpr float kDefaultTableEnd = 32.0f;
inline constexpr double kMaxOutputPercent = 1000.0;           // of the frame's sides; above 0
inline constexpr Range<double> kPixelAspect{1.0 / 16, 16.0};  // width of a pixel over its height

// Environments and views; docs/environments.md.
inline constexpr uint32_t kMaxPanoramaWidth = 8192;   // pixels
inline constexpr uint32_t kMaxPanoramaHeight = 4096;  // pixels
inline constexpr uint32_t kMaxObjects = 64;           // of a view
inline constexpr Range<double> kFovDeg{1.0, 170.0};
inline constexpr double kDefaultFovDeg = 60.0;
inline constexpr Range<double> kRotationDeg{-360.0, 360.0};
inline constexpr Range<double> kCameraAngleDeg{-360000.0, 360000.0};
inline constexpr double kMaxCoordinate = 1e6;  // of a camera or a sphere, and its radius
inline constexpr double kLeastRadius = 1e-6;
inline constexpr double kUnitTolerance = 1e-3;  // of a quaternion's length
inline constexpr uint32_t kDefaultViewSamples = 4;
inline constexpr Range<uint32_t> kCubeSize{16, 4096};  // a power of two

// Sessions.
inline constexpr Range<uint32_t> kLookahead{0, 16};         // frames
inline constexpr Range<double> kCutThresholdEv{0.0, 16.0};  // 0: no detection
inline constexpr Range<float> kPictureEv{-64.0f, 64.0f};    // a cell of SessionState.picture
inline constexpr Range<uint32_t> kJpegQuality{1, 100};
inline constexpr Range<int64_t> kMediaTimeNs{0, int64_t{1} << 62};
inline constexpr uint32_t kDefaultJpegQuality = 90;

}  // namespace candela::v1
