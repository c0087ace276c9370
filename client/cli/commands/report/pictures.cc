#include "client/cli/commands/report/pictures.h"

#include <algorithm>
#include <array>
#include <vector>

#include "client/run/picture_error.h"

namespace candela {
namespace {

// The pixels of `from` that pixel `i` of `to` covers: [begin, end), never empty.
struct Range {
  uint32_t begin, end;
};
Range share(uint32_t i, uint32_t from, uint32_t to) {
  const auto at = [&](uint64_t n) { return static_cast<uint32_t>(n * from / to); };
  return {at(i), std::max(at(i) + 1, at(uint64_t{i} + 1))};
}

uint32_t small_width(uint32_t width) { return std::min(width, kPageWidth); }

uint32_t small_height(uint32_t width, uint32_t height) {
  return std::max<uint32_t>(1, static_cast<uint32_t>(uint64_t{height} * small_width(width) / width));
}

template <typename Visit>
void visit_share(Range xs, Range ys, const Visit& visit) {
  for (uint32_t y = ys.begin; y < ys.end; ++y) {
    for (uint32_t x = xs.begin; x < xs.end; ++x) visit(x, y);
  }
}

}  // namespace

absl::StatusOr<Image> small_picture(std::span<const std::byte> rgba8, uint32_t width, uint32_t height) {
  absl::StatusOr<Image> small =
      make_image(small_width(width), small_height(width, height), ImageFormat::kRgba8);
  if (!small.ok()) return small;
  std::byte* out = small->pixels.data();
  for (uint32_t y = 0; y < small->height; ++y) {
    for (uint32_t x = 0; x < small->width; ++x) {
      const Range xs = share(x, width, small->width), ys = share(y, height, small->height);
      std::array<uint32_t, 3> sum{};
      visit_share(xs, ys, [&](uint32_t i, uint32_t j) {
        const std::byte* texel = rgba8.data() + (size_t{j} * width + i) * 4;
        for (size_t k = 0; k < 3; ++k) sum[k] += std::to_integer<uint32_t>(texel[k]);
      });
      const uint32_t count = (xs.end - xs.begin) * (ys.end - ys.begin);
      for (size_t k = 0; k < 3; ++k) *out++ = static_cast<std::byte>((sum[k] + count / 2) / count);
      *out++ = std::byte{255};
    }
  }
  return small;
}

absl::StatusOr<Image> small_error_map(std::span<const uint16_t> halves, uint32_t width, uint32_t height) {
  const uint32_t wide = small_width(width), high = small_height(width, height);
  std::vector<uint16_t> worst;
  worst.reserve(size_t{wide} * high);
  for (uint32_t y = 0; y < high; ++y) {
    for (uint32_t x = 0; x < wide; ++x) {
      uint16_t most = 0;  // errors are not negative, so their halves are ordered as their bits are
      visit_share(share(x, width, wide), share(y, height, high),
                  [&](uint32_t i, uint32_t j) { most = std::max(most, halves[size_t{j} * width + i]); });
      worst.push_back(most);
    }
  }
  return draw_error_map(worst, wide, high);
}

}  // namespace candela
