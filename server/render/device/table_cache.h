// A cache of colour tables on the device, in the form that resolve reads. Internal to server/render.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "server/vulkan/buffer.h"
#include "server/vulkan/recorder.h"
#include "shaders/color_table.h"

namespace candela {

// Keeps the kTables tables that were used last. Each is under 15 MB and does not count towards the memory
// budget. One thread at a time. The device outlives it.
class TableCache {
 public:
  static constexpr size_t kTables = 4;

  explicit TableCache(Device& device) : device_(device) {}

  // The device's copy of an equal table; valid until the next call. If the table is new and the device's
  // memory is not mapped, this uploads it in a separate submission. RESOURCE_EXHAUSTED if the device has no
  // memory for it; otherwise fails as Recorder::submit_and_wait does.
  absl::StatusOr<const Buffer*> get(const std::shared_ptr<const ColorTable>& table, Recorder& recorder);

 private:
  struct Entry {
    std::shared_ptr<const ColorTable> table;
    Buffer points;
  };

  Device& device_;
  std::vector<Entry> entries_;  // the most recently used last
};

}  // namespace candela
