// A part of a row that stays in the first cache while the stages of resolve pass over it.
#if defined(CANDELA_HOST_CHUNK_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_CHUNK_INL_H
#undef CANDELA_HOST_CHUNK_INL_H
#else
#define CANDELA_HOST_CHUNK_INL_H
#endif

#include <hwy/highway.h>

#include <array>

#include "server/render/host/lanes/glsl-inl.h"
#include "server/render/host/resolve/resolve.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

using glsl::F;
using glsl::U;
using glsl::vec3;

inline constexpr uint32_t kChunk = 256;

// R, G, B and alpha of the pixels, register by register in the lanes' order. What is beyond the last
// pixel repeats it.
struct Chunk {
  HWY_ALIGN float c[4][kChunk];

  HWY_INLINE vec3 rgb(uint32_t i) const {
    return {hn::Load(kFloats, c[0] + i), hn::Load(kFloats, c[1] + i), hn::Load(kFloats, c[2] + i)};
  }
  HWY_INLINE F alpha(uint32_t i) const { return hn::Load(kFloats, c[3] + i); }
  HWY_INLINE void set_rgb(uint32_t i, const vec3& v) {
    hn::Store(v.r.v, kFloats, c[0] + i);
    hn::Store(v.g.v, kFloats, c[1] + i);
    hn::Store(v.b.v, kFloats, c[2] + i);
  }
  HWY_INLINE void set_alpha(uint32_t i, F a) { hn::Store(a.v, kFloats, c[3] + i); }
};

// Pixels x to x + count - 1 of row y; at most kChunk of them.
struct RowPart {
  const ResolveJob& job;
  uint32_t x;
  uint32_t y;
  uint32_t count;
  // The bloom of this row at x and beyond, at the level's width: see LightRow. Null without bloom.
  std::array<const float*, 3> light;
};

// A stage is a loop of its own over a chunk. So curves, transfers and formats need not multiply. It copies
// what it needs of the part before its loop: Highway's stores may alias anything, so the loop would read it
// each time.
using Stage = void (*)(const RowPart& part, Chunk& chunk);

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
