#include "server/render/frame/table_points.h"

#include <cstring>

#include "server/base/check.h"

namespace candela {

void write_points(const ColorTable& table, std::byte* to) {
  std::memcpy(to, table.elements.data(), table.elements.size() * sizeof(TablePoint));
  to += table.elements.size() * sizeof(TablePoint);
  const size_t points = table.values.size() / 3;
  const size_t diagonal = size_t{table.size} * table.size + table.size + 1;
  for (size_t i = 0; i < points; ++i) {
    const size_t next = std::min(i + diagonal, points - 1);
    TablePoint point{};
    for (size_t k = 0; k < 3; ++k) {
      point[k] = table.values[3 * i + k] | uint32_t{table.values[3 * next + k]} << 16;
    }
    std::memcpy(to + i * sizeof point, point.data(), sizeof point);
  }
}

}  // namespace candela
