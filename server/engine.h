// The device with what lives on it, and its replacement when it is lost.
#pragma once

#include <atomic>
#include <functional>
#include <memory>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "server/base/metrics.h"
#include "server/render/device/texture_pool.h"
#include "server/render/renderer.h"
#include "server/vulkan/device.h"

namespace candela {

// What a frame's memory lives on.
struct Engine {
  Engine(std::unique_ptr<Device> d, uint64_t budget_bytes)
      : device(std::move(d)), pool(*device, budget_bytes) {}

  std::unique_ptr<Device> device;
  TexturePool pool;
  std::unique_ptr<Renderer> renderer;
};

// Opens a device, makes a renderer on it and holds it against the reference.
absl::StatusOr<std::shared_ptr<Engine>> start_engine(const DeviceOptions& options, uint64_t budget_bytes);

// How often a device is opened anew without a frame that was rendered in between.
inline constexpr int kMaxRebuilds = 3;

// Keeps an engine that works. One that is lost stays until the last of its frames has let go, so that for a
// while there may be the memory of two. Any thread, where nothing else is said.
class EngineKeeper {
 public:
  using Start = std::function<absl::StatusOr<std::shared_ptr<Engine>>()>;

  // `on_gone`, which may be empty, is called once, on the render thread, when kMaxRebuilds did not help:
  // every frame fails from then on.
  EngineKeeper(std::shared_ptr<Engine> first, Start start, Metrics& metrics, std::function<void()> on_gone);

  std::shared_ptr<Engine> engine() const;
  // The current engine's, with all that it needs: ask once for a frame, for its memory and its rendering.
  std::shared_ptr<Renderer> renderer() const;
  bool gone() const { return gone_; }

  // After each frame, on the render thread: what rendering it with `renderer` came to. Replaces an engine
  // that is lost, which takes some tenths of a second.
  void worked(const Renderer& renderer, const absl::Status& status);

  // For tests: this device is lost, and so are those that replace it, `times` in all.
  void lose(int times);

 private:
  void replace(const Engine& lost);

  const Start start_;
  Metrics& metrics_;
  const std::function<void()> on_gone_;
  mutable absl::Mutex mutex_;
  std::shared_ptr<Engine> engine_ ABSL_GUARDED_BY(mutex_);
  int rebuilds_ = 0;  // since the last good frame; the render thread's
  std::atomic<bool> gone_ = false;
  std::atomic<int> to_lose_ = 0;
};

}  // namespace candela
