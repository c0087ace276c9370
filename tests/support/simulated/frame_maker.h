// A frame maker without a device. What it meters and draws are exact functions of a frame's bytes, so cheap
// that a run of thousands of sessions can be compared with them bit by bit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "absl/functional/function_ref.h"
#include "server/render/frame/texture_pool.h"
#include "server/render/frame_maker.h"
#include "server/vulkan/device.h"

namespace candela::testing {

// What a frame's pixels give. The mean luminance is their hash, between 2^-8 and 2^8. The first eight bytes
// make the scene: frames that begin with the same ones differ by no cut, and others by more than 1 EV. Of a
// frame of zeros nothing is metered. Eight bytes of ones, at a multiple of eight in their row, are bad
// values.
class SimulatedScene {
 public:
  using Row = absl::FunctionRef<std::span<const std::byte>(uint32_t y)>;
  SimulatedScene(const FrameDesc& desc, Row row);
  // Of tight rows.
  SimulatedScene(const FrameDesc& desc, std::span<const std::byte> pixels);

  const FrameStats& stats() const { return stats_; }
  // INVALID_ARGUMENT if the settings reject bad values, and there are some.
  absl::Status check(const Settings& settings) const;
  // The image that is drawn of them, in tight rows: over and over the bits of the exposure, the number, a
  // hash of the pixels and one of the settings, eight bytes each.
  std::vector<std::byte> image(const Settings& settings, uint64_t sequence, double exposure) const;

 private:
  const FrameDesc desc_;
  uint64_t hash_ = 0;
  FrameStats stats_;
};

// The pixels of a view, in tight rows. Of the environment only its first harmonic counts, which is its
// identity here, and its format; of the view its camera.
std::vector<std::byte> simulated_view(const Environment& environment, const View& view,
                                      const FrameDesc& desc);

// Takes the memory that Renderer would take on a device with unified memory, but from the heap.
class SimulatedFrameMaker final : public FrameMaker {
 public:
  // `clock` outlives it, and it outlives its frames.
  SimulatedFrameMaker(uint64_t budget_bytes, Clock& clock);

  absl::StatusOr<FrameMemory> allocate(const FrameDesc& desc, const Settings& settings,
                                       Verify verify = Verify::kNo) override;
  absl::StatusOr<uint64_t> bytes_for(const FrameDesc& desc, const Settings& settings,
                                     Verify verify = Verify::kNo) const override;
  // A frame is metered once and drawn once; anything else ends the program.
  absl::StatusOr<Metered> meter(FrameMemory& memory, const Settings& settings) override;
  absl::StatusOr<FrameReport> draw(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                   const Metered& metered, const Exposed& exposed) override;
  // A view is the pixels of simulated_view().
  absl::Status prepare_view(Environment& environment, const BakeQuality& quality, bool objects) override;
  absl::Status render_view(Environment& environment, const View& view, FrameMemory& memory) override;
  // It bakes nothing: the caller of baker() ends the program. Its environments are those that a test makes
  // up.
  absl::Status check_environments() const override { return absl::OkStatus(); }
  EnvironmentBaker& baker() const override;

  // From now on every frame fails, as those of a lost device do.
  void lose() { lost_ = true; }
  PoolCounters counters() const { return pool_.counters(); }

 private:
  const DeviceSummary device_;
  const std::unique_ptr<Device> host_ = Device::host();
  TexturePool pool_;
  bool lost_ = false;
};

}  // namespace candela::testing
