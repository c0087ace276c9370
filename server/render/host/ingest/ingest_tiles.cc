// The tiles of ingest, for each target of Highway.
//
// A row of tiles is read in rows of texels from left to right, as they lie in memory. Each tile keeps its
// sums in between.
#include "server/render/host/lanes/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/ingest/ingest_tiles.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>

#include "server/render/host/ingest/any_run-inl.h"
#include "server/render/host/ingest/ingest_tiles.h"
#include "server/render/host/ingest/tile_sums-inl.h"
#include "server/render/plan/exposure.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

#if CANDELA_HOST_TARGET

namespace {

template <typename V>
uint32_t largest(V v) {
  return static_cast<uint32_t>(hn::GetLane(hn::MaxOfLanes(hn::DFromV<V>(), v)));
}

shader::TileRecord record_of(const TileSums& sums, const shader::IngestConstants& constants) {
  const bool sums_weights =
      constants.weights != shader::WEIGHTS_AVERAGE || constants.ignore != 0 || constants.alpha != 0;
  const uint64_t log2_sum = hn::GetLane(hn::SumOfLanes(kLongs, sums.log2_sum));
  const int32_t darkest = hn::GetLane(hn::MinOfLanes(kInts, sums.min_luminance));
  shader::TileRecord record{};
  record.log2_sum_low = static_cast<uint32_t>(log2_sum & 0xffff);
  record.log2_sum_high = static_cast<uint32_t>(log2_sum >> 16);
  if (sums_weights) record.weight_sum = hn::GetLane(hn::SumOfLanes(kUints, sums.weight_sum));
  record.max_luminance_bits = largest(sums.max_luminance);
  record.min_luminance_bits_inverted = ~static_cast<uint32_t>(std::max(darkest, 0));
  record.max_magnitude_bits = largest(sums.max_magnitude);
  record.negative_components = sums.negative_components;
  if (constants.light != 0) record.max_light_bits = largest(sums.max_light);
  record.nan_components = sums.nan_components;
  record.infinite_components = sums.infinite_components;
  record.clamped_components = sums.clamped_components;
  record.first_bad_texel_inverted = ~sums.first_bad_texel;
  record.negative_scene_components = sums.negative_scene_components;
  record.alpha_differs = sums.alpha_differs;
  record.absent_texels = sums.absent_texels;
  record.coverage = sums.coverage;
  return record;
}

// Copies serve several rows of tiles, so other threads add to them, too.
void add_bins(const Bins& bins, shader::HistogramBin* copy) {
  for (size_t i = 0; i < bins.count(); ++i) {
    if (bins[i] == 0) continue;
    std::atomic_ref(copy[i].weight)
        .fetch_add(static_cast<uint32_t>(bins[i] >> 32), std::memory_order_relaxed);
    std::atomic_ref(copy[i].offset_sum).fetch_add(static_cast<uint32_t>(bins[i]), std::memory_order_relaxed);
  }
}

// Tiles that are read together: their sums stay in the first cache.
constexpr uint32_t kTilesAtOnce = 32;
static_assert(shader::HISTOGRAM_TILES % kTilesAtOnce == 0);

// Meters tiles `first` to `last` - 1 of a row of tiles.
template <uint32_t kPixels>
void meter_tiles(const IngestWork& work, uint32_t tile_row, uint32_t first, uint32_t last, Bins* bins) {
  const shader::IngestConstants& constants = work.constants;
  const shader::InputParams& frame = work.params.frame;
  const Input input = {frame, kPixels, constants.matrix != 0, constants.scrub != 0};
  const bool may_be_plain = !input.matrix && !input.scrub && constants.weights == shader::WEIGHTS_AVERAGE &&
                            constants.ignore == 0 && constants.alpha == 0 && bins == nullptr;
  const Input plain_input = {frame, kPixels, false, false};
  std::array<TileSums, kTilesAtOnce> sums;
  const uint32_t rows_end = std::min((tile_row + 1) * kTileTexels, frame.height);
  for (uint32_t y = tile_row * kTileTexels; y < rows_end; ++y) {
    for (uint32_t tile = first; tile < last; ++tile) {
      const uint32_t x = tile * kTileTexels;
      const uint32_t count = std::min(kTileTexels, frame.width - x);
      const std::byte* at = work.wire + (size_t{y} * frame.input_pitch + x) * texel_bytes(kPixels);
      if (may_be_plain && PlainRun<kPixels>(plain_input).meter(at, count, sums[tile - first])) continue;
      AnyRun<kPixels>(work, input, bins, y, sums[tile - first]).meter(at, x, count);
    }
  }
  shader::TileRecord* records = work.tiles + size_t{tile_row} * work.params.tiles_x;
  for (uint32_t tile = first; tile < last; ++tile) records[tile] = record_of(sums[tile - first], constants);
}

template <uint32_t kPixels>
void meter_row(const IngestWork& work, uint32_t tile_row) {
  for (uint32_t tile = 0; tile < work.params.tiles_x;) {
    const uint32_t index = tile_row * work.params.tiles_x + tile;
    // Up to the next copy of the histogram.
    const uint32_t last = std::min(work.params.tiles_x, tile + kTilesAtOnce - index % kTilesAtOnce);
    if (work.histogram == nullptr) {
      meter_tiles<kPixels>(work, tile_row, tile, last, nullptr);
    } else {
      Bins bins(histogram_bins(work.constants.scrub != 0));
      meter_tiles<kPixels>(work, tile_row, tile, last, &bins);
      add_bins(bins, work.histogram + size_t{index / shader::HISTOGRAM_TILES} * bins.count());
    }
    tile = last;
  }
}

}  // namespace

#endif  // CANDELA_HOST_TARGET

void ingest_tiles_here([[maybe_unused]] const IngestWork& work, [[maybe_unused]] uint32_t tile_row) {
#if CANDELA_HOST_TARGET
  switch (work.constants.pixels) {
    case shader::PIXELS_RGBA16F:
      return meter_row<shader::PIXELS_RGBA16F>(work, tile_row);
    case shader::PIXELS_RGBA32F:
      return meter_row<shader::PIXELS_RGBA32F>(work, tile_row);
    default:
      return meter_row<shader::PIXELS_RGB9E5>(work, tile_row);
  }
#endif
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace candela::host {

HWY_EXPORT(ingest_tiles_here);

void ingest_tiles(const IngestWork& work, uint32_t tile_row) {
  HWY_DYNAMIC_DISPATCH(ingest_tiles_here)(work, tile_row);
}

}  // namespace candela::host
#endif
