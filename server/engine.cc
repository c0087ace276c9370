#include "server/engine.h"

#include <utility>

#include "server/base/log.h"
#include "server/render/self_test.h"

namespace candela {

absl::StatusOr<std::shared_ptr<Engine>> start_engine(const DeviceOptions& options, uint64_t budget_bytes) {
  absl::StatusOr<std::unique_ptr<Device>> device = Device::create(options);
  if (!device.ok()) return device.status();
  auto engine = std::make_shared<Engine>(*std::move(device), budget_bytes);
  absl::StatusOr<std::unique_ptr<Renderer>> renderer = Renderer::create(*engine->device, engine->pool);
  if (!renderer.ok()) return renderer.status();
  engine->renderer = *std::move(renderer);
  if (absl::Status status = self_test(*engine->renderer); !status.ok()) return status;
  return engine;
}

EngineKeeper::EngineKeeper(std::shared_ptr<Engine> first, Start start, Metrics& metrics,
                           std::function<void()> on_gone)
    : start_(std::move(start)), metrics_(metrics), on_gone_(std::move(on_gone)), engine_(std::move(first)) {}

std::shared_ptr<Engine> EngineKeeper::engine() const {
  absl::MutexLock lock(&mutex_);
  return engine_;
}

std::shared_ptr<Renderer> EngineKeeper::renderer() const {
  const std::shared_ptr<Engine> current = engine();
  return {current, current->renderer.get()};
}

void EngineKeeper::worked(const Renderer& renderer, const absl::Status& status) {
  if (status.ok()) {
    rebuilds_ = 0;
    return;
  }
  // A frame of an engine that was replaced fails, and tells nothing of this one.
  const std::shared_ptr<Engine> current = engine();
  if (&renderer == current->renderer.get() && current->device->lost()) replace(*current);
}

void EngineKeeper::replace(const Engine& lost) {
  if (gone_) return;
  const std::string& name = lost.device->summary().name;
  if (rebuilds_ == kMaxRebuilds) {
    gone_ = true;
    log_event(LogLevel::kError, "device is lost again and again; no frame is rendered any more",
              {{"device", name}, {"rebuilds", static_cast<int64_t>(rebuilds_)}});
    if (on_gone_) on_gone_();
    return;
  }
  ++rebuilds_;
  log_event(LogLevel::kWarning, "device lost",
            {{"device", name}, {"rebuild", static_cast<int64_t>(rebuilds_)}});
  absl::StatusOr<std::shared_ptr<Engine>> started = start_();
  if (started.ok() && (*started)->device->summary().name != name) {
    started = absl::UnavailableError("another device came in its place, with other limits: " +
                                     (*started)->device->summary().name);
  }
  if (!started.ok()) {
    log_event(LogLevel::kError, "device was not opened anew",
              {{"message", std::string(started.status().message())}});
    return;
  }
  if (to_lose_ > 0) {
    --to_lose_;
    (*started)->device->lose();
  }
  std::shared_ptr<Engine> old = *std::move(started);  // outlives the lock
  {
    absl::MutexLock lock(&mutex_);
    engine_.swap(old);
  }
  metrics_.device_rebuilt();
}

void EngineKeeper::lose(int times) {
  to_lose_ = times - 1;
  engine()->device->lose();
}

}  // namespace candela
