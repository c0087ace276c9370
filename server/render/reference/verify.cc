#include "server/render/reference/verify.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <queue>
#include <thread>
#include <utility>

#include "server/base/cgroup.h"
#include "server/render/color/aces.h"
#include "server/render/color/primaries.h"
#include "server/render/device/frame_memory.h"
#include "server/render/device/passes.h"
#include "shaders/bilinear.h"
#include "shaders/reference.h"

namespace candela {

namespace {

constexpr double kCodes = 255.0;
constexpr double kPercentile = 0.999;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A finished image as the host sees it.
struct Picture {
  const std::byte* texels;
  uint32_t pitch;   // texels from row to row
  uint32_t format;  // OUTPUT_*

  // Component k of a texel as a display value.
  double component(uint32_t x, uint32_t y, size_t k) const {
    const size_t index = (size_t{y} * pitch + x) * 4 + k;
    if (format == shader::OUTPUT_RGBA8) return std::to_integer<int>(texels[index]) / 255.0;
    if (format == shader::OUTPUT_FLOAT) return load<float>(index);
    const auto bits = load<uint16_t>(index);
    return format == shader::OUTPUT_RGBA16 ? bits / 65535.0 : imath_half_to_float(bits);
  }

  // The largest quantised value; 0 for formats that do not quantise.
  double steps() const {
    return format == shader::OUTPUT_RGBA8 ? 255.0 : format == shader::OUTPUT_RGBA16 ? 65535.0 : 0.0;
  }

 private:
  template <typename T>
  T load(size_t index) const {
    T value;
    std::memcpy(&value, texels + index * sizeof value, sizeof value);
    return value;
  }
};

// What resolving the reference needs.
struct Reference {
  reference::Scene scene;
  reference::BadCounts bad;
  reference::Meter meter;
  reference::Level bloom;
  uint32_t levels = 1;
  reference::ResolveParams params;
  std::optional<uint32_t> dither_frame;  // absent: no dither

  // Component k of texel (x, y) in steps of the output, not yet rounded; `value` is its display value.
  double quantised(double value, double steps, uint32_t x, uint32_t y, size_t k) const {
    if (!dither_frame) return value * steps;
    return std::clamp(value * steps + reference::dither_noise(x, y, *dither_frame, k), 0.0, steps);
  }
};

// The primaries' matrix, where the settings ask for one.
std::optional<reference::Matrix> matrix_of(const Settings& settings) {
  if (!settings.input_chromaticities) return std::nullopt;
  const auto matrix = matrix_to_rec709(*settings.input_chromaticities);
  return matrix.ok() ? *matrix : std::nullopt;
}

// E * prescale, cut as the pipeline cuts it.
double exposed(double exposure, const Settings& settings) {
  return std::min(exposure * settings.prescale, 0x1p46);
}

// aces-1 by OpenColorIO itself, so that the table's error counts; a client's table is what it is.
std::function<reference::Rgb(const reference::Rgb&)> look(const Settings& settings) {
  if (settings.curve == ToneCurve::kTable) {
    return [table = settings.table](const reference::Rgb& c) { return reference::look_up(*table, c); };
  }
  if (settings.curve != ToneCurve::kAces1) return nullptr;
  return [](const reference::Rgb& c) -> reference::Rgb {
    std::array<float, 3> rgb = {static_cast<float>(c[0]), static_cast<float>(c[1]), static_cast<float>(c[2])};
    if (!aces_1(rgb).ok()) return {NAN, NAN, NAN};
    return {rgb[0], rgb[1], rgb[2]};
  };
}

// The scene of the wire pixels.
reference::Scene ingest(const FrameMemory::Parts& parts, const Settings& settings,
                        reference::Rounding rounding, reference::BadCounts* bad) {
  const FrameDesc& desc = parts.desc;
  const size_t stride = size_t{parts.pitch} * bytes_per_pixel(desc.format);
  return reference::ingest({parts.host_input().mapped(), stride * desc.height}, stride, desc.width,
                           desc.height, static_cast<uint32_t>(desc.format), matrix_of(settings), rounding,
                           bad);
}

reference::Meter meter(const reference::Scene& scene, const MeteringSettings& metering) {
  return reference::meter(scene, {metering.statistic == MeterStatistic::kPercentile,
                                  metering.percentile_low,
                                  metering.percentile_high,
                                  static_cast<uint32_t>(metering.weights),
                                  {metering.spot.x0, metering.spot.y0, metering.spot.x1, metering.spot.y1}});
}

Reference make_reference(const FrameMemory::Parts& parts, const Settings& settings, const FrameMoment& moment,
                         double exposure, uint32_t level_size, reference::Rounding rounding) {
  Reference r;
  r.scene = ingest(parts, settings, rounding, &r.bad);
  r.meter = meter(r.scene, settings.exposure.metering);
  if (settings.bloom.intensity > 0) {
    r.params.bloom = static_cast<uint32_t>(settings.bloom.kind);
    r.bloom = reference::bloom(r.scene,
                               {r.params.bloom, settings.bloom.threshold, settings.bloom.softness,
                                settings.bloom.levels, settings.bloom.firefly_weights, level_size},
                               r.meter.mean_log2_luminance, &r.levels);
  }
  r.params.exposure = exposed(exposure, settings);
  r.params.level_size = settings.bloom.kind == BloomKind::kGaussian ? 4 : level_size;
  r.params.bloom_intensity = settings.bloom.intensity;
  r.params.curve = static_cast<uint32_t>(settings.curve);
  r.params.curve_white = settings.curve_white;
  r.params.transfer = static_cast<uint32_t>(output_transfer(settings));
  r.params.look = look(settings);
  if (settings.dither && settings.output_format != OutputFormat::kRgba16f)
    r.dither_frame = static_cast<uint32_t>(moment.sequence);
  return r;
}

// The device's bloom texture; all zero where it made none.
struct DeviceLevel {
  LevelSize size;
  const std::byte* texels;
  double scale;

  reference::Rgb at(int64_t x, int64_t y) const {
    if (texels == nullptr) return {};
    const auto cx = static_cast<size_t>(std::clamp<int64_t>(x, 0, int64_t{size.width} - 1));
    const auto cy = static_cast<size_t>(std::clamp<int64_t>(y, 0, int64_t{size.height} - 1));
    std::array<float, 4> texel;
    std::memcpy(texel.data(), texels + (cy * size.width + cx) * sizeof texel, sizeof texel);
    return {scale * texel[0], scale * texel[1], scale * texel[2]};
  }
};

// The light that the device's bloom adds at an intensity of 1, against the reference's at its texels and
// relative to the largest there is. A device's texture of half the reference's size is sampled as resolve
// does.
double bloom_error(const Reference& truth, const PassContext& context, bool any) {
  const FrameMemory::Parts& parts = context.parts;
  if (parts.levels.empty()) return 0.0;
  const DeviceLevel device = {parts.level_sizes[0], any ? parts.host_level().mapped() : nullptr,
                              1.0 / summed_levels(context)};
  const bool coarser = device.size.width < truth.bloom.width || device.size.height < truth.bloom.height;
  const double step = coarser ? 2.0 : 1.0;
  double largest = 0.0;
  double worst = 0.0;
  for (uint32_t y = 0; y < truth.bloom.height; ++y) {
    for (uint32_t x = 0; x < truth.bloom.width; ++x) {
      const reference::Rgb is = reference::bilinear(device, (x + 0.5) / step - 0.5, (y + 0.5) / step - 0.5);
      for (size_t k = 0; k < 3; ++k) {
        const double should = truth.bloom.at(x, y)[k] / truth.levels;
        const double error = std::abs(is[k] - should);
        worst = std::isnan(error) ? kInfinity : std::max(worst, error);
        largest = std::max(largest, should);
      }
    }
  }
  // Below a float's normal range the device may have flushed everything to 0.
  return worst / std::max<double>(largest, std::numeric_limits<float>::min());
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
    for (; !other.values_.empty(); other.values_.pop()) add(other.values_.top());
  }
  float least() const { return values_.top(); }

 private:
  const uint64_t count_;
  std::priority_queue<float, std::vector<float>, std::greater<>> values_;
};

// What some rows come to.
struct Tally {
  Verification worst;  // its maxima, worst pixel and count of differing components
  Largest largest;
};

// Runs work(first, last, part) for each part of the rows, on every core; returns when all are done.
template <typename Work>
void for_row_parts(uint32_t height, uint32_t parts, const Work& work) {
  std::vector<std::jthread> threads;
  for (uint32_t i = 0; i < parts; ++i) {
    const auto first = static_cast<uint32_t>(uint64_t{height} * i / parts);
    const auto last = static_cast<uint32_t>(uint64_t{height} * (i + 1) / parts);
    threads.emplace_back([&work, first, last, i] { work(first, last, i); });
  }
}

uint32_t row_parts(uint32_t height) {
  static const uint32_t cpus = usable_cpus();  // it reads files
  return std::clamp<uint32_t>(cpus, 1, height);
}

// Compares rows [first, last): adds their errors to the tally and to row_sums[y], and maps them where a map
// is wanted.
void compare_rows(const Reference& truth, const Picture& codes, const Picture& image, uint32_t first,
                  uint32_t last, Tally* tally, std::vector<double>* row_sums, uint16_t* map) {
  const double steps = image.steps();
  Verification& v = tally->worst;
  for (uint32_t y = first; y < last; ++y) {
    const auto row = reference::resolve_row(truth.scene, truth.bloom, truth.levels, truth.params, y);
    double sum = 0.0;
    for (uint32_t x = 0; x < row.size(); ++x) {
      double worst = 0.0;
      for (size_t k = 0; k < 3; ++k) {
        double error = std::abs(codes.component(x, y, k) - row[x][k]) * kCodes;
        if (std::isnan(error)) error = kInfinity;
        worst = std::max(worst, error);
        sum += error;
        tally->largest.add(static_cast<float>(error));
        const double off = std::abs(std::round(image.component(x, y, k) * steps) -
                                    std::round(truth.quantised(row[x][k], steps, x, y, k)));
        if (off != 0) ++v.differing;
        v.max_difference = std::max(v.max_difference, off);
      }
      if (worst > v.max_codes) {
        v.max_codes = worst;
        v.worst_x = x;
        v.worst_y = y;
      }
      if (map != nullptr) {
        map[size_t{y} * row.size() + x] = imath_float_to_half(static_cast<float>(worst));
      }
    }
    (*row_sums)[y] = sum;
  }
}

Verification compare(const Reference& truth, const Picture& codes, const Picture& image, uint16_t* map) {
  const uint32_t height = truth.scene.height;
  const uint64_t components = uint64_t{truth.scene.width} * height * 3;
  // p99.9 is the least of these.
  const auto rank = static_cast<uint64_t>(static_cast<double>(components - 1) * kPercentile);
  const uint64_t beyond = components - rank;
  const uint32_t parts = row_parts(height);
  std::vector<Tally> tallies(parts, {{}, Largest(beyond)});
  std::vector<double> row_sums(height);
  for_row_parts(height, parts, [&](uint32_t first, uint32_t last, uint32_t part) {
    compare_rows(truth, codes, image, first, last, &tallies[part], &row_sums, map);
  });
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
  // Row by row, so that the sum does not depend on how many threads there were.
  for (double sum : row_sums) v.mean_codes += sum / static_cast<double>(components);
  return v;
}

FrameStats stats_of(const Reference& truth) {
  FrameStats stats;
  stats.mean_log2_luminance = truth.meter.mean_log2_luminance;
  stats.min_luminance = static_cast<float>(truth.meter.min_luminance);
  stats.max_luminance = static_cast<float>(truth.meter.max_luminance);
  stats.nan_components = truth.bad.nan;
  stats.infinite_components = truth.bad.infinite;
  stats.negative_components = truth.bad.negative;
  return stats;
}

}  // namespace

double reference_mean_log2_luminance(const FrameMemory& memory, const Settings& settings) {
  reference::BadCounts bad;
  const reference::Scene scene = ingest(memory.parts(), settings, reference::Rounding::kNone, &bad);
  return meter(scene, settings.exposure.metering).mean_log2_luminance;
}

void render_by_reference(FrameMemory& memory, const Settings& settings, const FrameMoment& moment,
                         double exposure) {
  const FrameMemory::Parts& parts = memory.parts();
  const Reference truth =
      make_reference(parts, settings, moment, exposure, kWholeBloom, reference::Rounding::kNone);
  const Picture image = {parts.host_output().mapped(), parts.pitch,
                         static_cast<uint32_t>(parts.output_format)};
  const double steps = image.steps();
  const auto store = [&](std::byte* texels, size_t index, auto value) {
    std::memcpy(texels + index * sizeof value, &value, sizeof value);
  };
  for_row_parts(
      parts.desc.height, row_parts(parts.desc.height), [&](uint32_t first, uint32_t last, uint32_t) {
        for (uint32_t y = first; y < last; ++y) {
          const auto row = reference::resolve_row(truth.scene, truth.bloom, truth.levels, truth.params, y);
          for (uint32_t x = 0; x < row.size(); ++x) {
            for (size_t k = 0; k < 4; ++k) {
              const double value = row[x][k];
              const size_t index = (size_t{y} * parts.pitch + x) * 4 + k;
              if (parts.exact) store(parts.host_exact().mapped(), index, static_cast<float>(value));
              if (steps == 0.0) {
                store(parts.host_output().mapped(), index, imath_float_to_half(static_cast<float>(value)));
                continue;
              }
              const double code = std::round(k < 3 ? truth.quantised(value, steps, x, y, k)
                                                   : std::clamp(value, 0.0, 1.0) * steps);
              if (parts.output_format == OutputFormat::kRgba8) {
                store(parts.host_output().mapped(), index, static_cast<uint8_t>(code));
              } else {
                store(parts.host_output().mapped(), index, static_cast<uint16_t>(code));
              }
            }
          }
        }
      });
}

uint64_t reference_bytes_of(const FrameDesc& desc, const Settings& settings) {
  const uint64_t pixels = uint64_t{desc.width} * desc.height;
  std::vector<LevelSize> levels;
  if (settings.bloom.intensity > 0) {
    levels = settings.bloom.kind == BloomKind::kGaussian
                 ? gaussian_level_sizes(desc.width, desc.height)
                 : bloom_level_sizes(desc.width, desc.height, settings.bloom.levels, kWholeBloom);
  }
  uint64_t texels = 0;
  for (const LevelSize& level : levels) texels += uint64_t{level.width} * level.height;
  // And the errors beyond p99.9, sums of rows, rows under way and the Gaussian's third level: less than 2
  // bytes a pixel but in tiny frames.
  constexpr uint64_t kSmall = 1 << 16;
  return pixels * (4 * sizeof(float) + 2) + texels * sizeof(reference::Rgb) + kSmall;
}

FrameVerification verify_frame(FrameMemory& memory, const Settings& settings, const FrameReport& report,
                               const FrameMoment& moment, uint32_t bloom_level_size) {
  const FrameMemory::Parts& parts = memory.parts();
  const Picture image = {parts.host_output().mapped(), parts.pitch,
                         static_cast<uint32_t>(parts.output_format)};
  const Picture codes =
      parts.exact ? Picture{parts.host_exact().mapped(), parts.pitch, shader::OUTPUT_FLOAT} : image;
  const bool host = find_tier(settings.tier)->host_reference;
  const auto hold = [&](reference::Rounding rounding, uint16_t* map, FrameStats* truth) {
    const Reference reference =
        make_reference(parts, settings, moment, report.exposure, bloom_level_size, rounding);
    Verification v = compare(reference, codes, image, map);
    v.meter_error_ev = std::abs(report.stats.mean_log2_luminance - reference.meter.mean_log2_luminance);
    if (parts.exact && !host) {
      v.bloom_error = bloom_error(reference, pass_context(parts, settings), report.plan.bloom);
    }
    if (truth != nullptr) *truth = stats_of(reference);
    return v;
  };
  auto* map = parts.error_map ? reinterpret_cast<uint16_t*>(parts.error_map.buffer().mapped()) : nullptr;
  FrameVerification verification;
  verification.rounded =
      hold(host ? reference::Rounding::kNone : reference::Rounding::kHalf, map, &verification.truth);
  // Other frames' scenes are halves as they come.
  const bool rounds =
      !host && (parts.desc.format == PixelFormat::kRgba32f || matrix_of(settings).has_value());
  verification.unrounded = rounds ? hold(reference::Rounding::kNone, nullptr, nullptr) : verification.rounded;
  return verification;
}

}  // namespace candela
