#include "server/render/frame/tile_sums.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/base/check.h"
#include "server/render/plan/exposure.h"
#include "shaders/params.h"

namespace candela {

namespace {

constexpr double kFixedPointPerEv = 1u << shader::LOG2_FRACTION_BITS;

// What a sum is to be divided or multiplied by. If every alpha is 0 or 1, the weights are multiples of 255.
struct Units {
  uint64_t sums = 1;        // of the tiles and of the histogram's weights
  double offset_scale = 1;  // of the histogram's offsets
};

Units units_of(const IngestRead& read, bool center_weighted, uint32_t coverage) {
  if (center_weighted) return {1, 256.0};
  if (read.alpha != shader::METER_COVERAGE) return {};
  const bool parts = (coverage & 2) != 0;
  return {parts ? 1u : 255u, parts ? 255.0 : 1.0};
}

std::vector<MeterBin> bins_of(const FrameTextures& textures, const IngestRead& read, const Units& units) {
  const double offset_ev = units.offset_scale / kFixedPointPerEv;
  const size_t count = histogram_bins(read.scrub);
  std::vector<MeterBin> bins(count);
  for (size_t i = 0; i < textures.layout.histogram_copies * count; ++i) {
    shader::HistogramBin bin;
    std::memcpy(&bin, textures.host_histogram().mapped() + i * sizeof bin, sizeof bin);
    bins[i % count].weight += bin.weight / units.sums;
    bins[i % count].above_ev += bin.offset_sum * offset_ev;
  }
  return bins;
}

shader::TileRecord tile_at(const FrameTextures& textures, size_t index) {
  shader::TileRecord tile;
  std::memcpy(&tile, textures.host_tiles().mapped() + index * sizeof tile, sizeof tile);
  return tile;
}

uint64_t fixed_log2_of(const shader::TileRecord& tile) {
  return tile.log2_sum_low + (uint64_t{tile.log2_sum_high} << 16);
}

double log2_of(uint64_t fixed_log2, uint64_t weight) {
  return static_cast<double>(fixed_log2) / (kFixedPointPerEv * static_cast<double>(weight)) -
         shader::LOG2_BIAS;
}

// The coarse picture of the frame. A cell takes at least one tile each way.
ScenePrint print_of(const FrameTextures& textures, bool weighted, const Units& units) {
  constexpr uint32_t kCells = 8;
  const TextureLayout& layout = textures.layout;
  ScenePrint print;
  const auto first = [](uint32_t cell, uint32_t tiles) { return cell * tiles / kCells; };
  const auto last = [&](uint32_t cell, uint32_t tiles) {
    return std::max(first(cell, tiles) + 1, first(cell + 1, tiles));
  };
  const auto texels = [](uint32_t tile, uint32_t size) {
    return std::min(shader::TILE_TEXELS, size - tile * shader::TILE_TEXELS);
  };
  for (uint32_t cell = 0; cell < print.size(); ++cell) {
    uint64_t fixed_log2 = 0;
    uint64_t weight = 0;
    for (uint32_t y = first(cell / kCells, layout.tiles_y); y < last(cell / kCells, layout.tiles_y); ++y) {
      for (uint32_t x = first(cell % kCells, layout.tiles_x); x < last(cell % kCells, layout.tiles_x); ++x) {
        const shader::TileRecord tile = tile_at(textures, size_t{y} * layout.tiles_x + x);
        fixed_log2 += fixed_log2_of(tile);
        weight += weighted ? tile.weight_sum
                           : uint64_t{texels(x, layout.desc.width)} * texels(y, layout.desc.height);
      }
    }
    print[cell] =
        weight == 0 ? NAN : static_cast<float>(log2_of(fixed_log2 / units.sums, weight / units.sums));
  }
  return print;
}

// The sums of all tiles, in the shader's own numbers.
struct Totals {
  // At 16384 x 16384: 2^28 texels of 26 bits, and with weights of 8 bits, 2^62 at most.
  uint64_t fixed_log2 = 0;
  uint64_t weight = 0;
  uint32_t darkest_inverted = 0;
  uint32_t brightest = 0;
  uint32_t magnitude = 0;
  uint32_t alpha_differs = 0;
  uint32_t coverage = 0;
};

Totals add_tiles(const FrameTextures& textures, TileSums& sums) {
  const TextureLayout& layout = textures.layout;
  FrameStats& stats = sums.stats;
  Totals totals;
  for (size_t i = 0; i < size_t{layout.tiles_x} * layout.tiles_y; ++i) {
    const shader::TileRecord tile = tile_at(textures, i);
    totals.fixed_log2 += fixed_log2_of(tile);
    totals.weight += tile.weight_sum;
    totals.brightest = std::max(totals.brightest, tile.max_luminance_bits);
    totals.darkest_inverted = std::max(totals.darkest_inverted, tile.min_luminance_bits_inverted);
    totals.magnitude = std::max(totals.magnitude, tile.max_magnitude_bits);
    totals.alpha_differs |= tile.alpha_differs;
    totals.coverage |= tile.coverage;
    stats.absent_pixels += tile.absent_texels;
    stats.nan_components += tile.nan_components;
    stats.infinite_components += tile.infinite_components;
    stats.clamped_components += tile.clamped_components;
    stats.negative_components += tile.negative_components;
    stats.negative_scene_components += tile.negative_scene_components;
    if (!layout.level_sizes.empty()) stats.tile_light.push_back(std::bit_cast<float>(tile.max_light_bits));
    sums.first_bad_texel = std::min(sums.first_bad_texel, ~tile.first_bad_texel_inverted);
  }
  return totals;
}

void read_histogram(const FrameTextures& textures, const IngestPlan& plan, const IngestRead& read,
                    const Units& units, FrameStats& stats) {
  if (textures.layout.histogram_copies == 0) return;
  std::vector<MeterBin> bins = bins_of(textures, read, units);
  const auto lit = [](const MeterBin& bin) { return bin.weight != 0; };
  if (std::none_of(bins.begin() + shader::HISTOGRAM_BINS, bins.end(), lit))
    bins.resize(shader::HISTOGRAM_BINS);
  if (plan.percentiles && stats.metered_weight > 0) {
    const auto [low, high] = *plan.percentiles;
    stats.mean_log2_luminance = percentile_mean(bins, low, high);
  }
  if (!plan.wants_histogram) return;
  for (const MeterBin& bin : bins) stats.histogram.push_back(bin.weight);
}

absl::Status bad_pixel(const TileSums& sums, const FrameDesc& desc) {
  const FrameStats& stats = sums.stats;
  const bool all_finite = stats.nan_components + stats.infinite_components == 0;
  const std::string beyond = absl::StrFormat("%d component%s beyond 2^30", stats.clamped_components,
                                             stats.clamped_components == 1 ? "" : "s");
  const std::string counts =
      absl::StrFormat("%d NaN and %d infinite components", stats.nan_components, stats.infinite_components);
  return absl::InvalidArgumentError(absl::StrFormat(
      "the pixel at x %d, y %d is not %s (%s in all); repair the frame or use bad_values SCRUB",
      sums.first_bad_texel % desc.width, sums.first_bad_texel / desc.width,
      stats.clamped_components == 0 ? "finite"
      : all_finite                  ? "within 2^30"
                                    : "finite and within 2^30",
      all_finite                      ? beyond
      : stats.clamped_components == 0 ? counts
                                      : absl::StrCat(counts, ", ", beyond)));
}

}  // namespace

TileSums sum_tiles(const FrameTextures& textures, const IngestPlan& plan, const IngestRead& read) {
  const FrameDesc& desc = textures.layout.desc;
  CHECK(textures.host_tiles().bytes() >=
        uint64_t{textures.layout.tiles_x} * textures.layout.tiles_y * sizeof(shader::TileRecord));
  TileSums sums;
  FrameStats& stats = sums.stats;
  const Totals totals = add_tiles(textures, sums);
  const shader::IngestConstants& constants = plan.inputs.constants;
  if (constants.matrix == 0) stats.negative_scene_components = stats.negative_components;
  const bool weighted = constants.weights != shader::WEIGHTS_AVERAGE || constants.ignore != 0 ||
                        read.alpha != shader::METER_OPAQUE;
  const uint64_t pixels = uint64_t{desc.width} * desc.height;
  const Units units = units_of(read, constants.weights == shader::WEIGHTS_CENTER, totals.coverage);
  stats.metered_weight = weighted ? totals.weight / units.sums : pixels;
  CHECK(stats.metered_weight <= pixels * 255 && stats.absent_pixels <= pixels);
  stats.mean_log2_luminance = stats.metered_weight > 0
                                  ? log2_of(totals.fixed_log2 / units.sums, stats.metered_weight)
                                  : kNothingMetered;
  read_histogram(textures, plan, read, units, stats);
  stats.print = print_of(textures, weighted, units);
  stats.max_luminance = std::bit_cast<float>(totals.brightest);
  stats.min_luminance = std::bit_cast<float>(~totals.darkest_inverted);
  sums.needs_scrub = totals.magnitude > std::bit_cast<uint32_t>(shader::MAX_HALF);
  sums.alpha_differs = totals.alpha_differs != 0;
  sums.uncovered =
      read.alpha == shader::METER_COVERAGE && totals.coverage == 0 && stats.absent_pixels < pixels;
  return sums;
}

Drawn drawn_from_tiles(const FrameTextures& textures) {
  const shader::TileRecord tile = tile_at(textures, 0);
  const uint64_t sum = (uint64_t{tile.shown_sum_high} << shader::SHOWN_LOW_BITS) + tile.shown_sum_low;
  const ImageSize& image = textures.layout.image;
  return {tile.gamut_cut_components,
          std::bit_cast<float>(tile.negative_light_bits),
          {std::bit_cast<float>(tile.shown_max_bits),
           static_cast<double>(sum) / shader::SHOWN_SCALE / (double{1} * image.width * image.height)}};
}

absl::StatusOr<Metered> meter_frame(const IngestPlan& plan, const FrameDesc& desc, ReadFrame read_frame) {
  Metered metered;
  IngestRead read;
  absl::StatusOr<TileSums> sums = read_frame(read, /*again=*/false, &metered.stages);
  while (sums.ok()) {
    metered.alpha |= sums->alpha_differs;
    if (metered.alpha && !plan.ignores_alpha && read.alpha == shader::METER_OPAQUE) {
      read.alpha = shader::METER_COVERAGE;
    } else if (sums->needs_scrub && !read.scrub) {
      read.scrub = true;
    } else if (sums->uncovered) {
      read.alpha = shader::METER_ALIKE;
      metered.uncovered = true;
    } else {
      break;
    }
    sums = read_frame(read, /*again=*/true, &metered.stages);
  }
  if (!sums.ok()) return sums.status();
  metered.scrubbed = read.scrub && sums->needs_scrub;
  if (plan.rejects_bad_values && sums->first_bad_texel != UINT32_MAX) return bad_pixel(*sums, desc);
  metered.stats = std::move(sums->stats);
  return metered;
}

}  // namespace candela
