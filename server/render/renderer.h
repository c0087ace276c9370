// Renders frames on one device: meters a frame, and draws it at the exposure that was decided.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/render/executor_kind.h"
#include "server/render/frame/texture_pool.h"
#include "server/render/frame_maker.h"

namespace candela {

class Executor;
struct Drawn;

class Renderer final : public FrameMaker {
 public:
  // `device` and `pool` outlive the renderer. `threads` of the host make its passes; 0: usable_cpus().
  // FAILED_PRECONDITION, saying why, if the one that is to make them cannot.
  static absl::StatusOr<std::unique_ptr<Renderer>> create(Device& device, TexturePool& pool,
                                                          ExecutorKind executor = ExecutorKind::kAuto,
                                                          uint32_t threads = 0);
  ~Renderer() override;

  absl::StatusOr<FrameMemory> allocate(const FrameDesc& desc, const Settings& settings,
                                       Verify verify = Verify::kNo) override;
  absl::StatusOr<uint64_t> bytes_for(const FrameDesc& desc, const Settings& settings,
                                     Verify verify = Verify::kNo) const override;
  absl::StatusOr<Metered> meter(FrameMemory& memory, const Settings& settings) override;
  absl::StatusOr<FrameReport> draw(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                   const Metered& metered, const Exposed& exposed) override;
  // Made as the passes are.
  absl::Status prepare_view(Environment& environment, const BakeQuality& quality, bool objects) override;
  absl::Status render_view(Environment& environment, const View& view, FrameMemory& memory) override;
  absl::Status check_environments() const override;
  EnvironmentBaker& baker() const override { return *baker_; }

  // Who makes the passes, kDevice or kHost, and the same in words: "on the host, AVX2, 2 threads".
  ExecutorKind executor_kind() const { return executor_kind_; }
  const std::string& executor_words() const { return executor_words_; }

 private:
  Renderer(Device& device, TexturePool& pool);
  // Sets passes_ and what follows from it.
  absl::Status choose(ExecutorKind kind, uint32_t threads);
  Executor& executor_of(const FrameMemory& memory) const;
  // Makes the image in the memory's layout, and fills in the report except what verification finds.
  absl::StatusOr<Drawn> draw_image(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                   const Metered& metered, FrameReport& report);
  // The same with the cheapest tier that keeps max_error_codes, in its own layout.
  absl::Status draw_within_error(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                 const Metered& metered, FrameReport& report);

  Device& device_;
  TexturePool& pool_;
  ExecutorKind executor_kind_ = ExecutorKind::kDevice;
  std::string executor_words_;
  std::unique_ptr<Executor> by_device_or_host_;
  std::unique_ptr<Executor> by_reference_;
  std::unique_ptr<EnvironmentBaker> baker_;  // may use the threads of by_device_or_host_; null on the host
};

}  // namespace candela
