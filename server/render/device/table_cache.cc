#include "server/render/device/table_cache.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

namespace candela {

namespace {

using Texel = std::array<uint32_t, 4>;

// Writes each point beside its neighbour along the cube's diagonal, as table.glsl reads them. Points of the
// upper faces have no such neighbour, and no shader reads it.
void write_points(const ColorTable& table, std::byte* to) {
  const size_t points = table.values.size() / 3;
  const size_t diagonal = size_t{table.size} * table.size + table.size + 1;
  for (size_t i = 0; i < points; ++i) {
    const size_t next = std::min(i + diagonal, points - 1);
    Texel texel{};
    for (size_t k = 0; k < 3; ++k) {
      texel[k] = table.values[3 * i + k] | uint32_t{table.values[3 * next + k]} << 16;
    }
    std::memcpy(to + i * sizeof texel, texel.data(), sizeof texel);
  }
}

}  // namespace

absl::StatusOr<const Buffer*> TableCache::get(const std::shared_ptr<const ColorTable>& table,
                                              Recorder& recorder) {
  const auto found = std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) {
    return entry.table == table || *entry.table == *table;
  });
  if (found != entries_.end()) {
    std::rotate(found, found + 1, entries_.end());
    return &entries_.back().points;
  }

  if (entries_.size() == kTables) entries_.erase(entries_.begin());
  const uint64_t bytes = table->values.size() / 3 * sizeof(Texel);
  absl::StatusOr<Buffer> points = Buffer::create(device_, bytes, MemoryUse::kDevice);
  if (!points.ok()) return points.status();
  if (device_.unified_memory()) {
    write_points(*table, points->mapped());
  } else {
    absl::StatusOr<Buffer> upload = Buffer::create(device_, bytes, MemoryUse::kUpload);
    if (!upload.ok()) return upload.status();
    write_points(*table, upload->mapped());
    if (absl::Status status = recorder.begin(); !status.ok()) return status;
    recorder.copy(*upload, *points, bytes);
    if (absl::Status status = recorder.submit_and_wait(); !status.ok()) return status;
  }
  entries_.push_back({table, *std::move(points)});
  return &entries_.back().points;
}

}  // namespace candela
