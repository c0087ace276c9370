#include "server/device_keeper.h"

#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/base/digest.h"
#include "server/base/log.h"
#include "server/base/status_macros.h"
#include "server/render/host/host_executor.h"
#include "server/render/self_test.h"

#ifndef CANDELA_VERSION
#error "the build sets CANDELA_VERSION"
#endif

namespace candela {

namespace {

// One frame shows not every bit that a driver's compiler may choose.
std::string bits_of(const RenderDevice& opened, const std::string& rendered) {
  std::string all = absl::StrCat(CANDELA_VERSION, "\n", rendered);
  if (opened.renderer->executor_kind() == ExecutorKind::kDevice) {
    const DeviceSummary& device = opened.device->summary();
    absl::StrAppend(&all, "\n", device.name, "\n", device.driver);
  }
  return sha256_hex(all).substr(0, 16);
}

}  // namespace

absl::StatusOr<std::shared_ptr<RenderDevice>> open_render_device(const DeviceOptions& options,
                                                                 uint64_t budget_bytes, Clock& clock,
                                                                 ExecutorKind executor) {
  DeviceOptions wanted = options;
  wanted.host_without_gpu &= host::instruction_set() != nullptr;
  if (wanted.host_without_gpu && wanted.selector.empty() && executor == ExecutorKind::kHost) {
    wanted.selector = kHostDevice;
  }
  ASSIGN_OR_RETURN(std::unique_ptr<Device> device, Device::create(wanted));
  auto opened = std::make_shared<RenderDevice>(std::move(device), budget_bytes, clock);
  ASSIGN_OR_RETURN(opened->renderer, Renderer::create(*opened->device, opened->pool, executor));
  ASSIGN_OR_RETURN(const std::string rendered, self_test(*opened->renderer));
  opened->bits = bits_of(*opened, rendered);
  return opened;
}

DeviceKeeper::DeviceKeeper(std::shared_ptr<RenderDevice> first, Open open, Metrics& metrics, Events events)
    : open_(std::move(open)), metrics_(metrics), events_(std::move(events)), current_(std::move(first)) {}

DeviceKeeper::~DeviceKeeper() {
  // A device that hangs may still write into its memory, so nothing of it may be freed.
  if (!current()->device->hung()) return;
  // Reachable, so that tools do not call it a leak.
  static auto* const kept = new std::vector<std::shared_ptr<RenderDevice>>;
  kept->push_back(current());
}

std::shared_ptr<RenderDevice> DeviceKeeper::current() const {
  absl::MutexLock lock(&mutex_);
  return current_;
}

std::shared_ptr<Renderer> DeviceKeeper::renderer() const {
  const std::shared_ptr<RenderDevice> device = current();
  return {device, device->renderer.get()};
}

void DeviceKeeper::job_ended(const FrameMaker* renderer, const absl::Status& status) {
  const std::shared_ptr<RenderDevice> device = current();
  if (status.ok()) {
    // A frame of a device that was already replaced says nothing about the current one.
    if (renderer == device->renderer.get()) rebuilds_ = 0;
  } else if (device->device->hung()) {
    give_up("the device hangs; rendering has stopped", *device);
  } else if (device->device->lost()) {
    replace(*device);
  }
}

void DeviceKeeper::replace(const RenderDevice& lost) {
  if (gone_) return;
  const std::string& name = lost.device->summary().name;
  if (rebuilds_ == kMaxRebuilds) {
    return give_up("device is lost again and again; rendering has stopped", lost);
  }
  ++rebuilds_;
  log_event(LogLevel::kWarning, "device lost",
            {{"device", name}, {"rebuild", static_cast<int64_t>(rebuilds_)}});
  absl::StatusOr<std::shared_ptr<RenderDevice>> opened = open_();
  // Sessions go on with the same bits and limits only on the same kind of device.
  if (opened.ok() && (*opened)->device->summary().name != name) {
    opened = absl::UnavailableError("a different device, with other limits, was opened in its place: " +
                                    (*opened)->device->summary().name);
  } else if (opened.ok() && (*opened)->bits != lost.bits) {
    opened = absl::UnavailableError("the device that was opened in its place renders other bits");
  }
  // The lost device stays current. Its next frame fails and comes here again, until kMaxRebuilds.
  if (!opened.ok()) {
    log_event(LogLevel::kError, "cannot reopen the device",
              {{"message", std::string(opened.status().message())}});
    return;
  }
  if (to_lose_ > 0) {
    --to_lose_;
    (*opened)->device->lose();
  }
  std::shared_ptr<RenderDevice> old = *std::move(opened);  // outlives the lock
  {
    absl::MutexLock lock(&mutex_);
    current_.swap(old);
  }
  metrics_.device_rebuilt();
  if (events_.on_replaced) events_.on_replaced();
}

void DeviceKeeper::give_up(const char* event, const RenderDevice& device) {
  if (gone_.exchange(true)) return;
  log_event(LogLevel::kError, event,
            {{"device", device.device->summary().name}, {"rebuilds", static_cast<int64_t>(rebuilds_)}});
  if (events_.on_gone) events_.on_gone();
}

void DeviceKeeper::lose(int times) {
  to_lose_ = times - 1;
  current()->device->lose();
}

}  // namespace candela
