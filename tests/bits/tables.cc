// Stands in for server/render/color/aces.cc: tables of arithmetic that is exact. The real ones are made by
// OpenColorIO, whose bits are not Candela's.
#include <map>
#include <utility>

#include "server/render/color/aces.h"

namespace candela {

namespace {

std::shared_ptr<const ColorTable> table(uint32_t size, uint32_t axes, float end) {
  static auto& tables = *new std::map<std::pair<uint32_t, uint32_t>, std::shared_ptr<const ColorTable>>;
  std::shared_ptr<const ColorTable>& kept = tables[{size, axes}];
  if (kept) return kept;
  std::vector<float> rgb = lattice_light(size, axes, end);
  for (float& v : rgb) v = v > 0 ? v / (v + 0.8f) : v * 0.25f;
  kept = std::make_shared<const ColorTable>(make_color_table(size, axes, end, rgb));
  return kept;
}

}  // namespace

absl::Status aces_1(std::span<float>) { return absl::UnimplementedError("there is no OpenColorIO here"); }

absl::StatusOr<std::shared_ptr<const ColorTable>> aces_1_table(uint32_t size) {
  return table(size, shader::AXES_ACES, 32.0f);
}

absl::StatusOr<std::shared_ptr<const ColorTable>> aces_1_wide_table(uint32_t size) {
  return table(size, shader::AXES_AP1, 320.0f);
}

}  // namespace candela
