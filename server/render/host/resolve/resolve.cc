#include "server/render/host/lanes/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/resolve/resolve.cc"
#include <hwy/foreach_target.h>
// Only after foreach_target.h.
#include <hwy/highway.h>

#include "server/render/host/resolve/resolve.h"

#if CANDELA_HOST_TARGET
#include "server/render/host/resolve/cut-inl.h"
#include "server/render/host/resolve/write-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// The stages of a job, chosen once.
class Resolve {
 public:
  explicit Resolve(const ResolveJob& job)
      : job_(job),
        load_(is_usual(job) ? load_exposed_stage(job.constants) : load_stage(job.constants)),
        expose_(is_usual(job) ? no_stage : expose_stage(job.constants)),
        curve_(curve_stage(job.constants)),
        transfer_(transfer_stage(job.constants)),
        write_(write_stage(job.constants.output_format, job.constants.dither != 0)),
        counts_(job.constants.wide != 0 && job.constants.output_format != shader::OUTPUT_FLOAT),
        measures_(counts_ && job.constants.display != shader::DISPLAY_REC709) {
    if (job.constants.alpha != shader::ALPHA_STRAIGHT) return;
    std::memset(black_.c, 0, sizeof black_.c);
    show({job, 0, 0, kLanes, {}}, black_, nullptr);
  }

  void make(const RowPart& part, ResolveFound& found) const {
    Chunk chunk;
    load_(part, chunk);
    if (counts_) note_negative(part, chunk, found);
    expose_(part, chunk);
    if (counts_) count_cut(part, chunk, found);
    const uint32_t alpha = job_.constants.alpha;
    if (alpha != shader::ALPHA_ASSOCIATED) settle_alpha(part, chunk);
    if (job_.gain != nullptr) show_gain(part, chunk);
    if (alpha == shader::ALPHA_STRAIGHT) {
      show_straight(part, chunk, found);
    } else {
      show(part, chunk, &found);
    }
    write_(part, chunk);
  }

 private:
  // Notes in `found` how bright the light is, unless it is null.
  void show(const RowPart& part, Chunk& chunk, ResolveFound* found) const {
    curve_(part, chunk);
    if (measures_ && found != nullptr) note_shown(part, chunk, *found);
    transfer_(part, chunk);
  }

  void show_straight(const RowPart& part, Chunk& chunk, ResolveFound& found) const {
    Chunk own;
    split_straight(part, chunk, own);
    Chunk own_shown = own;
    show(part, chunk, &found);
    show(part, own_shown, nullptr);
    join_straight(part, chunk, own, own_shown, black_);
  }

  const ResolveJob& job_;
  const Stage load_;
  const Stage expose_;
  const Stage curve_;
  const Stage transfer_;
  const Stage write_;
  const bool counts_;
  const bool measures_;
  Chunk black_;  // its first register is how no light is shown; only for straight alpha
};

ResolveFound resolve_band(const ResolveJob& job, uint32_t first, uint32_t last) {
  ResolveFound found;
  const Resolve resolve(job);
  LightRow light(job);
  const uint32_t width = job.params.frame.width;
  for (uint32_t y = first; y < last; ++y) {
    const std::array<float*, 3>& row = light.make(y, 0, width);
    for (uint32_t x = 0; x < width; x += kChunk) {
      RowPart part = {job, x, y, std::min(kChunk, width - x), {}};
      for (uint32_t k = 0; k < 3 && row[k] != nullptr; ++k)
        part.light[k] = row[k] + x / job.constants.level_size;
      resolve.make(part, found);
    }
  }
  hwy::FlushStream();
  return found;
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#else

namespace candela::host::HWY_NAMESPACE {
ResolveFound resolve_band(const ResolveJob&, uint32_t, uint32_t) { return {}; }
}  // namespace candela::host::HWY_NAMESPACE

#endif

#if HWY_ONCE
namespace candela::host {

HWY_EXPORT(resolve_band);

ResolveFound resolve_rows(const ResolveJob& job, uint32_t first, uint32_t last) {
  return HWY_DYNAMIC_DISPATCH(resolve_band)(job, first, last);
}

}  // namespace candela::host
#endif
