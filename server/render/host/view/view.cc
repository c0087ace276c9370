#include "server/render/host/lanes/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/view/view.cc"
#include <hwy/foreach_target.h>
// Only after foreach_target.h.
#include <hwy/highway.h>

#include "server/render/host/view/view.h"

#if CANDELA_HOST_TARGET
#include "server/render/host/view/objects-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

void draw_part(const ViewJob& job, const ViewPart& part, uint32_t y) {
  const uint32_t x1 = std::min(part.x1, job.params.width);
  if (!part.objects) return job.floats ? draw_sky<true>(job, part, x1, y) : draw_sky<false>(job, part, x1, y);
  Objects objects(job, part);
  for (uint32_t x = part.x0; x < x1; x += kLanes) objects.draw(x, y, std::min<uint32_t>(x1 - x, kLanes));
}

void draw_rows(const ViewJob& job, std::span<const ViewPart> parts, uint32_t y0, uint32_t y1) {
  for (uint32_t y = y0; y < y1; ++y) {
    for (const ViewPart& part : parts) draw_part(job, part, y);
  }
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#else

namespace candela::host::HWY_NAMESPACE {
void draw_rows(const ViewJob&, std::span<const ViewPart>, uint32_t, uint32_t) {}
}  // namespace candela::host::HWY_NAMESPACE

#endif

#if HWY_ONCE
namespace candela::host {

HWY_EXPORT(draw_rows);

void draw_view_rows(const ViewJob& job, std::span<const ViewPart> parts, uint32_t y0, uint32_t y1) {
  HWY_DYNAMIC_DISPATCH(draw_rows)(job, parts, y0, y1);
}

}  // namespace candela::host
#endif
