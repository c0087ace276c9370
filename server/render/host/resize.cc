#include "server/render/host/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/resize.cc"
#include <hwy/foreach_target.h>
// Only after foreach_target.h.
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>

#include "server/render/host/bloom.h"
#include "server/render/host/resize.h"

#if CANDELA_HOST_TARGET
#include "server/render/host/light-inl.h"
#include "server/render/plan/plan.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

static_assert(kResizeChunk == kChunk);

// Rows of the frame's light, for some of its columns, chunk by chunk.
class FrameLight {
 public:
  FrameLight(const ResizeJob& job, TexelRange columns)
      : job_(job), columns_(columns), light_(job.lit), usual_(is_usual(job.plain)) {}

  uint32_t chunks() const { return (columns_.last - columns_.first + kChunk - 1) / kChunk; }
  uint32_t x_of(uint32_t chunk) const { return columns_.first + chunk * kChunk; }
  uint32_t count(uint32_t chunk) const { return std::min(kChunk, columns_.last - x_of(chunk)); }

  void begin(uint32_t y) {
    y_ = y;
    lit_ = job_.lit_groups[y / kResolveGroupRows];
    if (lit_) light_rows_ = light_.make(y, columns_.first, columns_.last);
  }
  void make(uint32_t index, Chunk& chunk) const {
    const ResolveJob& job = lit_ ? job_.lit : job_.plain;
    const uint32_t x = x_of(index);
    RowPart part = {job, x, y_, count(index), {}};
    if (lit_) {
      for (size_t k = 0; k < 3; ++k) part.light[k] = light_rows_[k] + x / job.constants.level_size;
    }
    if (usual_) return load_exposed_stage(job.constants)(part, chunk);
    load_stage(job.constants)(part, chunk);
    if (lit_) expose_stage(job.constants)(part, chunk);
  }

 private:
  const ResizeJob& job_;
  const TexelRange columns_;
  LightRow light_;
  const bool usual_;
  uint32_t y_ = 0;
  bool lit_ = false;
  std::array<float*, 3> light_rows_ = {};
};

// The weighted sum of rows of a chunk, and the smallest and largest of those under the main lobe.
struct Sums {
  Chunk sum;
  Chunk low;
  Chunk high;
};

// A row of the sum: the first one, one under the main lobe, or another.
HWY_NOINLINE inline void begin_sums(const Chunk& row, float weight, uint32_t components, uint32_t count,
                                    Sums& to) {
  for (uint32_t k = 0; k < components; ++k) {
    for (uint32_t i = 0; i < count; i += kLanes) {
      hn::Store(hn::Mul(set(weight), hn::Load(kFloats, row.c[k] + i)), kFloats, to.sum.c[k] + i);
      hn::Store(hn::Inf(kFloats), kFloats, to.low.c[k] + i);
      hn::Store(hn::Neg(hn::Inf(kFloats)), kFloats, to.high.c[k] + i);
    }
  }
}
HWY_NOINLINE inline void add_row(const Chunk& row, float weight, uint32_t components, uint32_t count,
                                 Sums& to) {
  for (uint32_t k = 0; k < components; ++k) {
    for (uint32_t i = 0; i < count; i += kLanes) {
      const VF sum = hn::Load(kFloats, to.sum.c[k] + i);
      hn::Store(hn::MulAdd(set(weight), hn::Load(kFloats, row.c[k] + i), sum), kFloats, to.sum.c[k] + i);
    }
  }
}
HWY_NOINLINE inline void widen(const Chunk& row, uint32_t components, uint32_t count, Sums& to) {
  for (uint32_t k = 0; k < components; ++k) {
    for (uint32_t i = 0; i < count; i += kLanes) {
      const VF x = hn::Load(kFloats, row.c[k] + i);
      hn::Store(hn::Min(x, hn::Load(kFloats, to.low.c[k] + i)), kFloats, to.low.c[k] + i);
      hn::Store(hn::Max(x, hn::Load(kFloats, to.high.c[k] + i)), kFloats, to.high.c[k] + i);
    }
  }
}

// Where column 0 of a row of the image is in the block. Its texels are kLanes floats apart.
HWY_INLINE float* block_row(const ResizeJob& job, uint32_t y) {
  const size_t row = y - job.block_rows.first;
  return job.block + (row / kBlocks * job.block_pitch * kBlocks + row % kBlocks) * 4;
}

// Neighbouring pixels of a row, to the block.
HWY_INLINE void store_texels(VF r, VF g, VF b, VF a, float* to) {
  HWY_ALIGN float texels[4 * kLanes];
  hn::StoreInterleaved4(natural(r), natural(g), natural(b), natural(a), kFloats, texels);
  for (size_t i = 0; i < kLanes; ++i) std::memcpy(to + i * kLanes, texels + 4 * i, 4 * sizeof(float));
}

// Divides sums by their number of texels. For a power of 2 the product is the same.
struct Mean {
  explicit Mean(uint32_t texels)
      : power_of_two((texels & (texels - 1)) == 0), count(static_cast<float>(texels)) {}
  HWY_INLINE VF of(VF sum) const {
    return power_of_two ? hn::Mul(sum, set(1.0f / count)) : hn::Div(sum, set(count));
  }
  bool power_of_two;
  float count;
};

// The rows and columns of resize_down(). Alpha is left out if every one is 1.
class Down {
 public:
  Down(const ResizeJob& job, TexelRange columns)
      : job_(job), filter_(*job.down), light_(job, columns), components_(job.lit.opaque ? 3 : 4) {}

  void make(TexelRange rows) {
    if (filter_.mean > 0 || filter_.taps > kKeptRows) return make_by_adding(rows);
    const size_t chunks = light_.chunks();
    const auto kept = hwy::AllocateAligned<Chunk>(filter_.taps * chunks);
    std::array<const Chunk*, kKeptRows> under;
    uint32_t next = job_.down_taps[rows.first].texels.first;
    for (uint32_t y = rows.first; y < rows.last; ++y) {
      const TexelRange range = job_.down_taps[y].texels;
      for (; next < range.last; ++next) {
        light_.begin(next);
        for (uint32_t i = 0; i < chunks; ++i) light_.make(i, kept[next % filter_.taps * chunks + i]);
      }
      for (uint32_t i = 0; i < chunks; ++i) {
        for (uint32_t k = range.first; k < range.last; ++k) {
          under[k - range.first] = &kept[k % filter_.taps * chunks + i];
        }
        weigh(under.data(), range, y, i);
      }
    }
  }

 private:
  // Where the chunk's texels of row y of the image are.
  float* to(uint32_t y, uint32_t chunk) const { return block_row(job_, y) + light_.x_of(chunk) * kLanes; }

  // From all rows of the frame under the filter, in one loop.
  HWY_NOINLINE void weigh(const Chunk* const* rows, TexelRange range, uint32_t y, uint32_t chunk) const {
    const float* const weights = filter_.weights_of(y);
    const TexelRange lobe = job_.down_taps[y].main_lobe;
    const uint32_t lobe_first = lobe.first - range.first;
    const uint32_t lobe_last = lobe.last - range.first;
    const uint32_t taps = range.last - range.first;
    float* const out = to(y, chunk);
    const uint32_t count = light_.count(chunk);
    const bool opaque = components_ == 3;
    for (uint32_t i = 0; i < count; i += kLanes) {
      VF r = hn::Zero(kFloats), g = r, b = r, a = r;
      const auto add = [&](uint32_t k) HWY_ATTR {
        const VF weight = set(weights[k]);
        r = hn::MulAdd(weight, hn::Load(kFloats, rows[k]->c[0] + i), r);
        g = hn::MulAdd(weight, hn::Load(kFloats, rows[k]->c[1] + i), g);
        b = hn::MulAdd(weight, hn::Load(kFloats, rows[k]->c[2] + i), b);
        if (!opaque) a = hn::MulAdd(weight, hn::Load(kFloats, rows[k]->c[3] + i), a);
      };
      for (uint32_t k = 0; k < lobe_first; ++k) add(k);
      VF low_r = hn::Inf(kFloats), low_g = low_r, low_b = low_r, low_a = low_r;
      VF high_r = hn::Neg(low_r), high_g = high_r, high_b = high_r, high_a = high_r;
      const auto widen_to = [&](VF x, VF& low, VF& high) HWY_ATTR {
        low = hn::Min(x, low);
        high = hn::Max(x, high);
      };
      for (uint32_t k = lobe_first; k < lobe_last; ++k) {
        add(k);
        widen_to(hn::Load(kFloats, rows[k]->c[0] + i), low_r, high_r);
        widen_to(hn::Load(kFloats, rows[k]->c[1] + i), low_g, high_g);
        widen_to(hn::Load(kFloats, rows[k]->c[2] + i), low_b, high_b);
        if (!opaque) widen_to(hn::Load(kFloats, rows[k]->c[3] + i), low_a, high_a);
      }
      for (uint32_t k = lobe_last; k < taps; ++k) add(k);
      store_texels(hn::Clamp(r, low_r, high_r), hn::Clamp(g, low_g, high_g), hn::Clamp(b, low_b, high_b),
                   opaque ? set(1.0f) : hn::Clamp(a, low_a, high_a), out + i * kLanes);
    }
  }

  // Row by row of the frame: for a mean, and for a filter whose rows are too many to keep.
  void make_by_adding(TexelRange rows) {
    const auto sums = hwy::AllocateAligned<Sums>(light_.chunks());
    const auto row = hwy::AllocateAligned<Chunk>(1);
    for (uint32_t y = rows.first; y < rows.last; ++y) {
      const TexelRange range = job_.down_taps[y].texels;
      const TexelRange lobe = filter_.mean > 0 ? TexelRange{} : job_.down_taps[y].main_lobe;
      for (uint32_t k = range.first; k < range.last; ++k) {
        const float weight = filter_.mean > 0 ? 1.0f : filter_.weights_of(y)[k - range.first];
        light_.begin(k);
        for (uint32_t i = 0; i < light_.chunks(); ++i) {
          light_.make(i, row[0]);
          const auto step = k == range.first ? begin_sums : add_row;
          step(row[0], weight, components_, light_.count(i), sums[i]);
          if (k >= lobe.first && k < lobe.last) widen(row[0], components_, light_.count(i), sums[i]);
        }
      }
      for (uint32_t i = 0; i < light_.chunks(); ++i) finish(sums[i], y, i);
    }
  }

  HWY_NOINLINE void finish(const Sums& sums, uint32_t y, uint32_t chunk) const {
    float* const out = to(y, chunk);
    const uint32_t count = light_.count(chunk);
    const bool opaque = components_ == 3;
    const Mean mean(filter_.mean);
    for (uint32_t i = 0; i < count; i += kLanes) {
      const auto value = [&](size_t k) HWY_ATTR {
        const VF sum = hn::Load(kFloats, sums.sum.c[k] + i);
        if (filter_.mean > 0) return mean.of(sum);
        return hn::Clamp(sum, hn::Load(kFloats, sums.low.c[k] + i), hn::Load(kFloats, sums.high.c[k] + i));
      };
      store_texels(value(0), value(1), value(2), opaque ? set(1.0f) : value(3), out + i * kLanes);
    }
  }

  const ResizeJob& job_;
  const AxisFilter& filter_;
  FrameLight light_;
  const uint32_t components_;
};

void down(const ResizeJob& job, TexelRange rows, TexelRange columns) { Down(job, columns).make(rows); }

// The texel at a column of some rows, under the filter of one output. `from` is at column 0.
HWY_INLINE VF weighted(const float* from, const Taps& taps, const float* weight) {
  const float* texel = from + size_t{taps.texels.first} * kLanes;
  VF sum = hn::Zero(kFloats);
  VF low = hn::Inf(kFloats);
  VF high = hn::Neg(low);
  const auto add = [&](uint32_t count) HWY_ATTR {
    for (const float* const end = weight + count; weight < end; ++weight, texel += kLanes) {
      sum = hn::MulAdd(set(*weight), hn::LoadU(kFloats, texel), sum);
    }
  };
  add(taps.main_lobe.first - taps.texels.first);
  const float* under = texel;
  add(taps.main_lobe.last - taps.main_lobe.first);
  for (; under < texel; under += kLanes) {
    low = hn::Min(hn::LoadU(kFloats, under), low);
    high = hn::Max(hn::LoadU(kFloats, under), high);
  }
  add(taps.texels.last - taps.main_lobe.last);
  return hn::Clamp(sum, low, high);
}

HWY_INLINE VF summed(const float* from, uint32_t count) {
  VF sum = hn::LoadU(kFloats, from);
  for (uint32_t k = 1; k < count; ++k) sum = hn::Add(sum, hn::LoadU(kFloats, from + k * kLanes));
  return sum;
}

// As many rows at once as a register holds texels.
void across(const ResizeJob& job, TexelRange rows) {
  const AxisFilter& filter = *job.across;
  const Mean mean(filter.mean);
  for (uint32_t y = rows.first; y < rows.last; y += kBlocks) {
    const float* const from = block_row(job, y);
    float* const to = job.scene + 4 * size_t{y} * job.scene_pitch;
    const size_t count = std::min<size_t>(kBlocks, rows.last - y);
    for (uint32_t i = 0; i < filter.to; ++i) {
      const Taps& taps = job.across_taps[i];
      HWY_ALIGN float texels[kLanes];
      hn::Store(filter.mean > 0 ? mean.of(summed(from + size_t{taps.texels.first} * kLanes, filter.mean))
                                : weighted(from, taps, filter.weights_of(i)),
                kFloats, texels);
      for (size_t row = 0; row < count; ++row) {
        std::memcpy(to + 4 * (row * job.scene_pitch + i), texels + 4 * row, 4 * sizeof(float));
      }
    }
  }
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#else

namespace candela::host::HWY_NAMESPACE {
void down(const ResizeJob&, TexelRange, TexelRange) {}
void across(const ResizeJob&, TexelRange) {}
}  // namespace candela::host::HWY_NAMESPACE

#endif

#if HWY_ONCE
namespace candela::host {

HWY_EXPORT(down);
HWY_EXPORT(across);

void resize_down(const ResizeJob& job, TexelRange rows, TexelRange columns) {
  HWY_DYNAMIC_DISPATCH(down)(job, rows, columns);
}
void resize_across(const ResizeJob& job, TexelRange rows) { HWY_DYNAMIC_DISPATCH(across)(job, rows); }

namespace {

// What a thread keeps of the frame's rows while it adds them up.
constexpr uint64_t kKeptBytes = 1 << 20;
// A slice ends between two units of work, so none has more texels of the frame than this; units for each
// thread, so that all end at about the same time; and rows of the image that are worth making the rows around
// them twice.
constexpr uint64_t kMostTexelsOfUnit = uint64_t{1} << 20;
constexpr uint32_t kUnitsPerThread = 3;
constexpr uint32_t kLeastRows = 16;

// The work of resize_down() on a block.
struct Units {
  uint32_t columns;  // of a unit
  uint32_t across;   // units side by side
  uint32_t rows;     // of a unit
  uint32_t down;     // units one below the other
};

Units units_of(const AxisFilter& down, uint32_t width, uint32_t rows, uint32_t threads) {
  const uint32_t chunks = groups(width, kResizeChunk);
  const uint64_t kept_rows = down.mean > 0 || down.taps > kKeptRows ? 3 : down.taps;
  const uint64_t frame_rows = uint64_t{rows} * down.from / down.to + down.taps;
  // Rows are read whole if they can be: processors fetch what follows.
  const uint64_t most =
      std::min<uint64_t>(kKeptBytes / (kept_rows * 4 * sizeof(float) * kResizeChunk), chunks);
  uint64_t columns = std::max<uint64_t>(1, most) * kResizeChunk;
  const uint64_t wanted = std::max<uint64_t>(kUnitsPerThread * threads * columns / width,
                                             frame_rows * columns / kMostTexelsOfUnit);
  const uint64_t least = down.mean > 0 ? 1 : kLeastRows;
  Units units{};
  units.rows =
      static_cast<uint32_t>(std::min<uint64_t>(rows, std::max(least, rows / std::max<uint64_t>(1, wanted))));
  units.rows = groups(units.rows, kResizeRowStep) * kResizeRowStep;
  units.down = groups(rows, units.rows);
  // Rows of the image that many of the frame's make have fewer columns.
  const uint64_t rows_of_unit = uint64_t{std::min(units.rows, rows)} * down.from / down.to + down.taps;
  const uint64_t fit = kMostTexelsOfUnit / rows_of_unit / kResizeChunk;
  columns = std::min(columns, std::max<uint64_t>(1, fit) * kResizeChunk);
  units.columns = static_cast<uint32_t>(columns);
  units.across = groups(width, units.columns);
  return units;
}

std::vector<Taps> taps_of(const AxisFilter& filter) {
  std::vector<Taps> taps;
  taps.reserve(filter.to);
  for (uint32_t i = 0; i < filter.to; ++i) taps.push_back({filter.texels(i), filter.main_lobe(i)});
  return taps;
}

ResizeJob job_of(const ResizeStep& step, const FrameTextures& textures) {
  const ResolveStep& frame = step.frame;
  ResizeJob job;
  job.lit = {.constants = frame.inputs.constants, .params = frame.inputs.params, .opaque = frame.opaque};
  job.lit.wire = textures.input.buffer().mapped();
  job.plain = job.lit;
  job.plain.constants.bloom = shader::BLOOM_NONE;
  job.lit_groups.resize(groups(frame.inputs.params.frame.height, kResolveGroupRows));
  for (const Box& box : frame.bloom_groups) {
    std::fill(job.lit_groups.begin() + box.y0, job.lit_groups.begin() + box.y1, true);
  }
  if (frame.bloom_groups.empty()) {
    job.lit.constants.bloom = shader::BLOOM_NONE;
  } else {
    job.lit.level = level_planes(textures, 0);
  }
  job.down = &step.down;
  job.across = &step.across;
  job.down_taps = taps_of(step.down);
  job.across_taps = taps_of(step.across);
  job.block = reinterpret_cast<float*>(textures.resize_block.buffer().mapped());
  job.block_pitch = textures.layout.resize_pitch;
  job.scene = reinterpret_cast<float*>(textures.scene.buffer().mapped());
  job.scene_pitch = textures.layout.image_pitch;
  return job;
}

}  // namespace

void run_resize(const ResizeStep& step, const FrameTextures& textures, Crew& crew) {
  ResizeJob job = job_of(step, textures);
  const uint32_t width = step.across.from;
  const uint32_t height = step.down.to;
  const uint32_t block_rows = textures.layout.resize_rows;
  for (uint32_t first = 0; first < height; first += block_rows) {
    const uint32_t last = std::min(first + block_rows, height);
    job.block_rows = {first, last};
    const Units units = units_of(step.down, width, last - first, crew.threads());
    crew.run(units.across * units.down, [&](uint32_t i) {
      const uint32_t x = i % units.across * units.columns;
      const uint32_t y = first + i / units.across * units.rows;
      resize_down(job, {y, std::min(y + units.rows, last)}, {x, std::min(x + units.columns, width)});
    });
    const uint32_t rows =
        groups(last - first, kUnitsPerThread * kResizeRowStep * crew.threads()) * kResizeRowStep;
    crew.run(groups(last - first, rows), [&](uint32_t i) {
      const uint32_t y = first + i * rows;
      resize_across(job, {y, std::min(y + rows, last)});
    });
  }
}

}  // namespace candela::host
#endif
