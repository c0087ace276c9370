#include "server/render/device/table_cache.h"

#include <utility>

#include "server/base/status_macros.h"

namespace candela {

absl::StatusOr<std::shared_ptr<const Buffer>> TableCache::get(const std::shared_ptr<const ColorTable>& table,
                                                              Recorder& recorder) {
  if (std::shared_ptr<const Buffer> found = tables_.find(table)) return found;
  tables_.make_room();
  const uint64_t bytes = point_count(*table) * sizeof(TablePoint);
  ASSIGN_OR_RETURN(Buffer points, Buffer::create(device_, bytes, MemoryUse::kDevice));
  if (device_.unified_memory()) {
    write_points(*table, points.mapped());
  } else {
    ASSIGN_OR_RETURN(Buffer upload, Buffer::create(device_, bytes, MemoryUse::kUpload));
    write_points(*table, upload.mapped());
    RETURN_IF_ERROR(recorder.begin());
    recorder.copy(upload, points, bytes);
    RETURN_IF_ERROR(recorder.submit_and_wait());
  }
  return tables_.keep(table, std::move(points));
}

}  // namespace candela
