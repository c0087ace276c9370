// The device that renders, and its replacement when it is lost.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "server/base/metrics.h"
#include "server/render/frame/texture_pool.h"
#include "server/render/renderer.h"
#include "server/vulkan/device.h"

namespace candela {

// A device with its texture pool and its renderer. Each frame holds a reference to it.
struct RenderDevice {
  RenderDevice(std::unique_ptr<Device> d, uint64_t budget_bytes, Clock& clock)
      : device(std::move(d)), pool(*device, budget_bytes, clock) {}

  std::unique_ptr<Device> device;
  TexturePool pool;
  std::unique_ptr<Renderer> renderer;
  std::string bits;  // see DeviceInfo
};

// Opens a device, creates its renderer and compares a test frame with the reference. `clock` outlives the
// result. If the host cannot make the passes, it is not used in place of a missing GPU.
absl::StatusOr<std::shared_ptr<RenderDevice>> open_render_device(const DeviceOptions& options,
                                                                 uint64_t budget_bytes, Clock& clock,
                                                                 ExecutorKind executor);

// The number of times that a device is reopened without a good frame in between.
inline constexpr int kMaxRebuilds = 3;

// Owns the current RenderDevice and replaces it when it is lost. A lost one lives until its last frame lets
// go of it, so for a while the process may hold the memory of two. Any thread, unless a function says
// otherwise.
class DeviceKeeper {
 public:
  using Open = std::function<absl::StatusOr<std::shared_ptr<RenderDevice>>()>;

  // What the owner wants to know. Both are called on the render thread or on a job's own, and may be empty.
  struct Events {
    // Another device is the current one.
    std::function<void()> on_replaced = {};
    // The device is lost again after kMaxRebuilds replacements, or it hangs. Called once. From then on every
    // frame fails.
    std::function<void()> on_gone = {};
  };

  DeviceKeeper(std::shared_ptr<RenderDevice> first, Open open, Metrics& metrics, Events events);
  // Does not destroy a device that hangs.
  ~DeviceKeeper();

  std::shared_ptr<RenderDevice> current() const;
  // The current renderer; the pointer keeps its RenderDevice alive. Call it once per frame, so that the
  // frame's memory and its rendering use the same device.
  std::shared_ptr<Renderer> renderer() const;
  bool gone() const { return gone_; }

  // Call it on the thread that used the device, after each frame and every other job, with its result.
  // `renderer` is the frame's, null for other jobs. Replaces the current device if it is lost; that takes
  // some tenths of a second.
  void job_ended(const FrameMaker* renderer, const absl::Status& status);

  // For tests: loses this device and its replacements, `times` devices in all.
  void lose(int times);

 private:
  void replace(const RenderDevice& lost);
  void give_up(const char* event, const RenderDevice& device);

  const Open open_;
  Metrics& metrics_;
  const Events events_;
  mutable absl::Mutex mutex_;
  std::shared_ptr<RenderDevice> current_ ABSL_GUARDED_BY(mutex_);
  int rebuilds_ = 0;  // since the last good frame; used by one thread at a time
  std::atomic<bool> gone_ = false;
  std::atomic<int> to_lose_ = 0;
};

}  // namespace candela
