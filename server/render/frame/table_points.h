// Colour tables in the form that resolve reads, and a cache of them. Internal to server/render.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "server/base/check.h"
#include "shaders/color_table.h"

namespace candela {

// A point beside its neighbour along the cube's diagonal; see table.glsl.
using TablePoint = std::array<uint32_t, 4>;

inline size_t point_count(const ColorTable& table) { return table.elements.size() + table.values.size() / 3; }

// Writes point_count() points. Those of the upper faces have no such neighbour, and nothing reads it.
void write_points(const ColorTable& table, std::byte* to);

// Keeps what was made of the kTables tables that were used last. Each is under 15 MB and does not count
// towards the memory budget. Whoever uses one holds it, because other frames may be drawn between the slices
// of a large one. One thread at a time.
template <typename Points>
class TablesUsedLast {
 public:
  static constexpr size_t kTables = 4;

  // Those of an equal table, or null.
  std::shared_ptr<const Points> find(const std::shared_ptr<const ColorTable>& table) {
    const auto found = std::find_if(entries_.begin(), entries_.end(), [&](const auto& entry) {
      return entry.first == table || *entry.first == *table;
    });
    if (found == entries_.end()) return nullptr;
    std::rotate(found, found + 1, entries_.end());
    return entries_.back().second;
  }

  // Makes room for another one; call it before that is made.
  void make_room() {
    if (entries_.size() == kTables) entries_.erase(entries_.begin());
  }
  std::shared_ptr<const Points> keep(std::shared_ptr<const ColorTable> table, Points points) {
    CHECK(entries_.size() < kTables);
    entries_.emplace_back(std::move(table), std::make_shared<const Points>(std::move(points)));
    return entries_.back().second;
  }

 private:
  // The most recently used last.
  std::vector<std::pair<std::shared_ptr<const ColorTable>, std::shared_ptr<const Points>>> entries_;
};

}  // namespace candela
