// Colour tables on the device, as resolve reads them. Internal to server/render.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "server/vulkan/buffer.h"
#include "server/vulkan/recorder.h"
#include "shaders/color_table.h"

namespace candela {

// Keeps the tables that were used last, kTables at most, each under 5 MB and beside the memory budget. One
// thread at a time. The device outlives it.
class TableCache {
 public:
  static constexpr size_t kTables = 4;

  explicit TableCache(Device& device) : device_(device) {}

  // The device's copy of an equal table; valid until the next call. Where it is new and the device's memory
  // is not mapped, uploads it in a submission of its own. RESOURCE_EXHAUSTED when the device has no memory
  // for it, or as Recorder::submit_and_wait.
  absl::StatusOr<const Buffer*> get(const std::shared_ptr<const ColorTable>& table, Recorder& recorder);

 private:
  struct Entry {
    std::shared_ptr<const ColorTable> table;
    Buffer points;
  };

  Device& device_;
  std::vector<Entry> entries_;  // the latest used last
};

}  // namespace candela
