// The numbers of the wire contract, beside the contract: the server checks them, the client offers them in
// its --help. Units are in the names; ranges are inclusive.
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
inline constexpr uint32_t kMaxPendingChanges = 16;  // SettingsChanges that no frame has reached yet

inline constexpr uint64_t kMaxTableBytes = 65 * 65 * 65 * 6;  // values of the largest colour table

template <typename T>
struct Range {
  T min;
  T max;
};

// Settings: what each may be, and what it is where the message leaves it out.
inline constexpr Range<double> kManualEv{-40.0, 40.0};           // EV
inline constexpr Range<double> kCompensationEv{-40.0, 40.0};     // EV
inline constexpr Range<double> kKey{1e-6, 1e6};                  // scene-linear
inline constexpr Range<double> kExposureLimit{0x1p-40, 0x1p40};  // factor; min_exposure <= max_exposure
inline constexpr Range<double> kPrescale{0x1p-40, 0x1p40};       // factor
inline constexpr Range<double> kPercentile{0.0, 100.0};          // percent
inline constexpr double kLeastPercentileRange = 1e-6;            // percent; from low to high
inline constexpr Range<double> kAdaptationSpeed{0.0, 1000.0};    // per second
inline constexpr Range<double> kElapsedSeconds{0.0, 1e9};        // of media time
inline constexpr Range<double> kMaxErrorCodes{0.0, 255.0};       // codes
inline constexpr Range<double> kMaxMs{0.001, 1e9};               // device time of a frame
inline constexpr Range<double> kCurveWhite{0.01, 65504.0};       // exposed luminance
inline constexpr Range<uint32_t> kTableSize{2, 65};              // points a side
inline constexpr Range<double> kTableEnd{1.0, 65504.0};          // exposed light
inline constexpr Range<double> kBloomIntensity{0.0, 10.0};       // factor; 0 is no bloom
inline constexpr Range<double> kConserveIntensity{0.0, 1.0};     // of CONSERVE, a mix
inline constexpr Range<double> kBloomThreshold{0.0, 65504.0};    // scene-linear luminance, before exposure
inline constexpr Range<double> kBloomSoftness{0.0, 1.0};         // knee as a fraction of the threshold
inline constexpr Range<uint32_t> kBloomLevels{1, 16};

// Sessions.
inline constexpr Range<uint32_t> kLookahead{0, 16};         // frames
inline constexpr Range<double> kCutThresholdEv{0.0, 16.0};  // 0: no detection
inline constexpr Range<uint32_t> kJpegQuality{1, 100};
inline constexpr Range<int64_t> kMediaTimeNs{0, int64_t{1} << 62};
inline constexpr uint32_t kDefaultJpegQuality = 90;

inline constexpr double kDefaultManualEv = 0.0;
inline constexpr double kDefaultCompensationEv = 0.0;
inline constexpr double kDefaultKey = 0.18;
inline constexpr double kDefaultMinExposure = 1.0 / 64;
inline constexpr double kDefaultMaxExposure = 64.0;
inline constexpr double kDefaultPercentileLow = 10.0;
inline constexpr double kDefaultPercentileHigh = 90.0;
inline constexpr double kDefaultSpeedUp = 3.0;
inline constexpr double kDefaultSpeedDown = 1.0;
inline constexpr double kDefaultPrescale = 1.0;
inline constexpr float kDefaultCurveWhite = 4.0f;
inline constexpr float kDefaultBloomIntensity = 0.05f;
inline constexpr float kDefaultBloomThreshold = 1.0f;
inline constexpr float kDefaultGaussianThreshold = 8.0f;  // times the metered mean
inline constexpr float kDefaultBloomSoftness = 0.5f;
inline constexpr uint32_t kDefaultBloomLevels = 5;
inline constexpr bool kDefaultFireflyWeights = true;
inline constexpr float kDefaultTableEnd = 32.0f;
inline constexpr char kDefaultTier[] = "standard";

}  // namespace candela::v1
