#include "server/render/reference/compare.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <queue>
#include <utility>
#include <vector>

#include "server/base/slices.h"
#include "server/render/reference/row_parts.h"

namespace candela {

namespace {

constexpr double kCodes = 255.0;
constexpr double kPercentile = 0.999;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <typename T>
T load(const std::byte* texels, size_t index) {
  T value;
  std::memcpy(&value, texels + index * sizeof value, sizeof value);
  return value;
}

// The `count` largest of many values.
class Largest {
 public:
  explicit Largest(uint64_t count) : count_(count) {}

  void add(float value) {
    if (values_.size() < count_) {
      values_.push(value);
    } else if (value > values_.top()) {
      values_.pop();
      values_.push(value);
    }
  }
  void add(Largest other) {
    for (; !other.values_.empty(); other.values_.pop()) {
      add(other.values_.top());
      checkpoint();
    }
  }
  float least() const { return values_.top(); }

 private:
  const uint64_t count_;
  std::priority_queue<float, std::vector<float>, std::greater<>> values_;
};

// The errors of some rows.
struct Tally {
  Verification worst;  // its maxima, worst pixel and count of differing components
  Largest largest;
};

// A component of a pixel with straight alpha, composited over black and over white.
std::array<double, 2> composited(double colour, double alpha) {
  return {colour * alpha, colour * alpha + 1.0 - alpha};
}

// The error of component k of a pixel whose value should be `truth`, in codes. Straight colour has no exact
// value where alpha is nearly 0, so it is compared as people see it.
double error_in_codes(const Picture& picture, uint32_t x, uint32_t y, size_t k,
                      const std::array<double, 4>& truth, bool straight) {
  const double is = picture.component(x, y, k);
  double error = std::abs(is - truth[k]);
  if (straight) {
    const auto seen = composited(is, picture.component(x, y, 3));
    const auto should = composited(truth[k], truth[3]);
    error = std::max(std::abs(seen[0] - should[0]), std::abs(seen[1] - should[1]));
  }
  return std::isnan(error) ? kInfinity : error * kCodes;
}

// Adds the errors of these texels to the tally, to *sum, and to the map if there is one.
void compare_span(const ReferenceFrame& truth, const Picture& codes, const Picture& image,
                  const RowSpan& span, Tally* tally, double* sum, uint16_t* map) {
  const auto row = truth.row(span);
  const double largest = largest_code(image.format);
  Verification& v = tally->worst;
  const uint32_t y = span.y;
  for (uint32_t x = span.first; x < span.last; ++x) {
    const std::array<double, 4>& should = row[x - span.first];
    const bool unseen = truth.straight() && std::round(image.component(x, y, 3) * largest) == 0 &&
                        std::round(should[3] * largest) == 0;
    double worst = 0.0;
    for (size_t k = 0; k < 3; ++k) {
      const double error = error_in_codes(codes, x, y, k, should, truth.straight());
      worst = std::max(worst, error);
      *sum += error;
      tally->largest.add(static_cast<float>(error));
      const double off = std::abs(std::round(image.component(x, y, k) * largest) -
                                  std::round(truth.code(should[k], largest, x, y, k)));
      if (unseen) continue;
      if (off != 0) ++v.differing;
      v.max_difference = std::max(v.max_difference, off);
    }
    if (worst > v.max_codes) {
      v.max_codes = worst;
      v.worst_x = x;
      v.worst_y = y;
    }
    if (map != nullptr) map[size_t{y} * truth.width() + x] = imath_float_to_half(static_cast<float>(worst));
  }
}

Verification add_up(std::vector<Tally> tallies, const std::vector<double>& row_sums, uint64_t components,
                    uint64_t beyond) {
  Verification v;
  Largest largest(beyond);
  for (Tally& tally : tallies) {
    if (tally.worst.max_codes > v.max_codes) {
      v.max_codes = tally.worst.max_codes;
      v.worst_x = tally.worst.worst_x;
      v.worst_y = tally.worst.worst_y;
    }
    v.differing += tally.worst.differing;
    v.max_difference = std::max(v.max_difference, tally.worst.max_difference);
    largest.add(std::move(tally.largest));
  }
  v.components = components;
  v.p999_codes = largest.least();
  // Row by row, so that the sum does not depend on the number of threads.
  for (double sum : row_sums) v.mean_codes += sum / static_cast<double>(components);
  return v;
}

// Level 0 as it was drawn; all zero if it was not.
struct DrawnLevel {
  std::optional<LevelView> texels;
  double scale;

  reference::Rgb at(int64_t x, int64_t y) const {
    if (!texels) return {};
    const LevelSize& size = texels->size();
    const auto cx = static_cast<size_t>(std::clamp<int64_t>(x, 0, int64_t{size.width} - 1));
    const auto cy = static_cast<size_t>(std::clamp<int64_t>(y, 0, int64_t{size.height} - 1));
    const std::array<float, 3> texel = texels->at(cx, cy);
    return {scale * texel[0], scale * texel[1], scale * texel[2]};
  }
};

}  // namespace

double Picture::component(uint32_t x, uint32_t y, size_t k) const {
  const size_t index = (size_t{y} * pitch + x) * 4 + k;
  if (format == shader::OUTPUT_RGBA8) return std::to_integer<int>(texels[index]) / 255.0;
  if (format == shader::OUTPUT_FLOAT) return load<float>(texels, index);
  const auto bits = load<uint16_t>(texels, index);
  return format == shader::OUTPUT_RGBA16 ? bits / 65535.0 : imath_half_to_float(bits);
}

Verification compare(const ReferenceFrame& truth, const Picture& codes, const Picture& image, uint16_t* map) {
  const uint32_t height = truth.height();
  const uint64_t components = uint64_t{truth.width()} * height * 3;
  // p99.9 is the least of the errors from this rank on.
  const auto rank = static_cast<uint64_t>(static_cast<double>(components - 1) * kPercentile);
  const uint64_t beyond = components - rank;
  const uint32_t parts = row_parts(height);
  std::vector<Tally> tallies(parts, {{}, Largest(beyond)});
  std::vector<double> row_sums(height);
  for_row_parts(truth.width(), height, parts, [&](const RowSpan& span, uint32_t part) {
    compare_span(truth, codes, image, span, &tallies[part], &row_sums[span.y], map);
  });
  return add_up(std::move(tallies), row_sums, components, beyond);
}

double bloom_error(const ReferenceFrame& truth, const FrameTextures& textures, bool rendered) {
  const TextureLayout& layout = textures.layout;
  if (layout.level_sizes.empty()) return 0.0;
  const LevelSize& size = layout.level_sizes[0];
  DrawnLevel drawn = {std::nullopt, 1.0 / layout.summed_levels};
  if (rendered) drawn.texels.emplace(textures, size, textures.host_level());
  const reference::Level& level = truth.bloom();
  const bool coarser = size.width < level.width || size.height < level.height;
  const double step = coarser ? 2.0 : 1.0;
  double largest = 0.0;
  double worst = 0.0;
  for (uint32_t y = 0; y < level.height; ++y) {
    for (uint32_t x = 0; x < level.width; ++x) {
      const reference::Rgb is = reference::bilinear(drawn, (x + 0.5) / step - 0.5, (y + 0.5) / step - 0.5);
      const reference::Rgb should = truth.bloom_light(x, y);
      for (size_t k = 0; k < 3; ++k) {
        const double error = std::abs(is[k] - should[k]);
        worst = std::isnan(error) ? std::numeric_limits<double>::infinity() : std::max(worst, error);
        largest = std::max(largest, should[k]);
      }
    }
    checkpoint();
  }
  // Below a float's normal range the device may have flushed everything to 0.
  return worst / std::max<double>(largest, std::numeric_limits<float>::min());
}

}  // namespace candela
