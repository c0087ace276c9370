#include "server/render/device/table_cache.h"

#include <utility>

namespace candela {

absl::StatusOr<std::shared_ptr<const Buffer>> TableCache::get(const std::shared_ptr<const ColorTable>& table,
                                                              Recorder& recorder) {
  if (std::shared_ptr<const Buffer> found = tables_.find(table)) return found;
  tables_.make_room();
  const uint64_t bytes = point_count(*table) * sizeof(TablePoint);
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
  return tables_.keep(table, *std::move(points));
}

}  // namespace candela
