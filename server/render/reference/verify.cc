#include "server/render/reference/verify.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <queue>
#include <utility>
#include <vector>

#include "server/base/slices.h"
#include "server/render/reference/reference_frame.h"

namespace candela {
namespace {

// Compares an image and its bloom with the reference, component by component.

// A finished image as the host sees it.
struct Picture {
  const std::byte* texels;
  uint32_t pitch;   // texels from row to row
  uint32_t format;  // OUTPUT_*

  // Component k of a texel as a display value.
  double component(uint32_t x, uint32_t y, size_t k) const;
};

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

double Picture::component(uint32_t x, uint32_t y, size_t k) const {
  const size_t index = (size_t{y} * pitch + x) * 4 + k;
  if (format == shader::OUTPUT_RGBA8) return std::to_integer<int>(texels[index]) / 255.0;
  if (format == shader::OUTPUT_FLOAT) return load<float>(texels, index);
  const auto bits = load<uint16_t>(texels, index);
  return format == shader::OUTPUT_RGBA16 ? bits / 65535.0 : imath_half_to_float(bits);
}

// Fills in everything but meter_error_ev and bloom_error. `codes` is the image on which codes are measured,
// `image` the one that the client gets. `map` receives the largest error of each texel, as halves in rows
// without a gap; null: no map. Uses every core.
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

// The largest error of the light that bloom adds at an intensity of 1, at the texels of the reference's level
// 0 and relative to the largest value there; 0 if the settings ask for no bloom. `rendered`: the device made
// bloom; otherwise its light counts as 0. A device's level of half the reference's size is sampled as resolve
// does.
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

FrameStats stats_of(const MeteredScene& metered) {
  FrameStats stats;
  stats.mean_log2_luminance = metered.meter.mean_log2_luminance;
  stats.min_luminance = static_cast<float>(metered.meter.min_luminance);
  stats.max_luminance = static_cast<float>(metered.meter.max_luminance);
  stats.nan_components = metered.bad.nan;
  stats.infinite_components = metered.bad.infinite;
  stats.clamped_components = metered.bad.clamped;
  stats.negative_components = metered.bad.negative;
  stats.negative_scene_components = metered.bad.negative_scene;
  stats.absent_pixels = metered.meter.absent;
  return stats;
}

// `whole`, if not null, receives the reference's statistics and counts.
Verification compare_with(reference::Rounding rounding, const FrameTextures& textures, const Plan& plan,
                          const FrameStats& stats, uint32_t level_size, uint16_t* map,
                          FrameVerification* whole) {
  const TextureLayout& layout = textures.layout;
  const ReferencePlan& p = plan.reference;
  ReferenceFrame reference(meter_scene(textures, p.matrix, p.meter, rounding), plan, level_size);
  const bool wide = plan.resolve.inputs.constants.wide != 0;
  if ((wide || p.unrounded) && rounding == reference::Rounding::kHalf) reference.unround(textures, plan);
  const Picture image = {textures.host_output().mapped(), layout.image_pitch,
                         static_cast<uint32_t>(layout.output_format)};
  const Picture codes =
      textures.exact ? Picture{textures.host_exact().mapped(), layout.image_pitch, shader::OUTPUT_FLOAT}
                     : image;
  const MeteredScene& metered = reference.metered();
  Verification v = compare(reference, codes, image, map);
  v.meter_error_ev = std::abs(stats.mean_log2_luminance - metered.meter.mean_log2_luminance);
  if (textures.exact && !layout.by_reference) {
    v.bloom_error = bloom_error(reference, textures, plan.bloom());
  }
  if (whole != nullptr) {
    whole->truth = stats_of(metered);
    whole->gamut_cut_components = wide ? reference.cut_components() : 0;
  }
  return v;
}

}  // namespace

FrameVerification verify_frame(FrameMemory& memory, const Plan& plan, const FrameStats& stats,
                               uint32_t bloom_level_size) {
  using reference::Rounding;
  const FrameTextures& textures = memory.textures();
  const TextureLayout& layout = textures.layout;
  auto* map =
      textures.error_map ? reinterpret_cast<uint16_t*>(textures.error_map.buffer().mapped()) : nullptr;
  FrameVerification verification;
  verification.rounded = compare_with(layout.by_reference ? Rounding::kNone : Rounding::kHalf, textures, plan,
                                      stats, bloom_level_size, map, &verification);
  // If there is no matrix, the scenes of other formats are already halves.
  const bool rounds = !layout.by_reference &&
                      (layout.desc.format == v1::PIXEL_FORMAT_RGBA32F || plan.reference.matrix.has_value());
  verification.unrounded =
      rounds ? compare_with(Rounding::kNone, textures, plan, stats, bloom_level_size, nullptr, nullptr)
             : verification.rounded;
  return verification;
}

}  // namespace candela
