// A cache of colour tables on the device. Internal to server/render.
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "server/render/frame/table_points.h"
#include "server/vulkan/buffer.h"
#include "server/vulkan/recorder.h"

namespace candela {

// One thread at a time. The device outlives it.
class TableCache {
 public:
  explicit TableCache(Device& device) : device_(device) {}

  // The device's copy of an equal table. If the table is new and the device's
  // memory is not mapped, this uploads it in a separate submission. RESOURCE_EXHAUSTED if the device has no
  // memory for it; otherwise fails as Recorder::submit_and_wait does.
  absl::StatusOr<std::shared_ptr<const Buffer>> get(const std::shared_ptr<const ColorTable>& table,
                                                    Recorder& recorder);

 private:
  Device& device_;
  TablesUsedLast<Buffer> tables_;
};

}  // namespace candela
