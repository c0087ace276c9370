// Renders frames on one device: ingest and meter, decide, bloom and resolve.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/render/device/texture_pool.h"
#include "server/render/plan/exposure.h"
#include "server/render/plan/plan.h"
#include "server/render/settings/frame.h"
#include "server/render/settings/settings.h"

namespace candela {

// Whether a frame is held against the float64 reference, and whether a map of its error is kept.
enum class Verify { kNo, kYes, kWithMap };

// The memory of one frame, taken from the pool and given back to it when this is destroyed: the wire pixels
// coming in, the image going out, and the textures between. Movable. One thread at a time.
class FrameMemory {
 public:
  FrameMemory();
  FrameMemory(FrameMemory&&) noexcept;
  FrameMemory& operator=(FrameMemory&&) noexcept;
  ~FrameMemory();

  const FrameDesc& desc() const;
  // Where the wire's row y goes: desc().row_bytes() bytes, written once, not read (it may be uncached
  // memory).
  std::span<std::byte> input_row(uint32_t y);
  // The finished image's row y, tight: width * bytes_per_pixel(output). Valid after render() succeeded, until
  // this is destroyed. Cached memory. `output_contiguous` says whether rows follow each other without a gap.
  std::span<const std::byte> output_row(uint32_t y) const;
  bool output_contiguous() const;
  // Row y of the error map as halves: the largest error of R, G and B in codes, infinite for a NaN. Rows
  // follow each other without a gap. Valid as output_row() is; empty where no map was asked for.
  std::span<const uint16_t> error_map_row(uint32_t y) const;
  // What it takes of the pool's budget until then.
  uint64_t bytes() const;
  // Gives everything but the finished image and its error map back to the pool: a slow reader holds no more
  // than it reads.
  void keep_output_only();

  struct Parts;
  // The textures themselves, for server/render and its tests.
  const Parts& parts() const { return *parts_; }

 private:
  friend class Renderer;
  std::unique_ptr<Parts> parts_;
};

// Where a frame stands among others.
struct FrameMoment {
  uint64_t sequence = 0;                     // the client's number; the dither depends on its low 32 bits
  std::optional<PreviousExposure> previous;  // absent: the frame takes its target at once
};

struct StageTime {
  const char* name;  // a pass's name, see plan.h, or "upload", "download", "verify"
  uint64_t ns;       // device time; of "reference" and "verify" the host's
};

// How far an image is from the reference, over R, G and B. A code is 1/255 of the display range; codes are
// measured on the image before it is quantised. A NaN counts as an infinite error.
struct Verification {
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
  uint32_t worst_x = 0;
  uint32_t worst_y = 0;
  uint64_t components = 0;
  uint64_t differing = 0;       // components whose quantised values differ; none are for RGBA16F
  double max_difference = 0.0;  // of quantised values, in steps of the output format
  double meter_error_ev = 0.0;  // of the mean log2 luminance
  double bloom_error = 0.0;     // of bloom level 0, relative to its largest value; 0 without bloom
};

struct FrameVerification {
  Verification rounded;    // the reference rounds the scene to halves, as the pipeline does
  Verification unrounded;  // it does not
  FrameStats truth;        // what the reference metered and counted; tile_light is not filled
};

// What is known about a frame after it was rendered; the image is in its FrameMemory.
struct FrameReport {
  FrameStats stats;
  double exposure = 0.0;  // the factor E that was used
  double target = 0.0;    // the factor that the metering asked for
  Plan plan;
  std::vector<StageTime> stages;
  std::optional<FrameVerification> verification;  // where the memory was allocated for it
};

// What phase A measured. If the tier renders on the host, the mean log2 luminance is the float64 reference's;
// the other statistics are the device's.
struct Metered {
  FrameStats stats;
  bool scrubbed = false;  // the frame had to be read again with the scrub
  std::vector<StageTime> stages{};
};

class Renderer {
 public:
  // `device` and `pool` outlive the renderer.
  static absl::StatusOr<std::unique_ptr<Renderer>> create(Device& device, TexturePool& pool);
  ~Renderer();

  // Takes the memory for a frame. RESOURCE_EXHAUSTED when the pool's budget can never hold it, UNAVAILABLE
  // when it does not beside the frames in flight. The settings' output format and bloom and `verify` decide
  // what is taken. Any thread; never waits.
  absl::StatusOr<FrameMemory> allocate(const FrameDesc& desc, const Settings& settings,
                                       Verify verify = Verify::kNo);

  // Renders the pixels in `memory` to completion. `settings` must have passed check_settings and be those
  // that the memory was allocated with. INVALID_ARGUMENT naming the pixel when BadValues::kReject meets a bad
  // one; UNAVAILABLE when the device is lost. One thread at a time; blocks for the frame's time, which with
  // verification is seconds for a large one.
  absl::StatusOr<FrameReport> render(FrameMemory& memory, const Settings& settings,
                                     const FrameMoment& moment = {});

  // The two halves of render(). The caller decides the exposure between them, and may meter or draw other
  // frames before it calls draw(), once.
  absl::StatusOr<Metered> meter(FrameMemory& memory, const Settings& settings);
  absl::StatusOr<FrameReport> draw(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                   const Metered& metered, const Exposed& exposed);

 private:
  struct Impl;
  explicit Renderer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace candela
