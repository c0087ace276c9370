// The shader's own text about cubes and views.
#if defined(CANDELA_HOST_VIEW_TEXT_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_VIEW_TEXT_INL_H
#undef CANDELA_HOST_VIEW_TEXT_INL_H
#else
#define CANDELA_HOST_VIEW_TEXT_INL_H
#endif

#include <hwy/highway.h>

#include "server/render/host/lanes/glsl-inl.h"
#include "server/render/host/view/view.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

using glsl::B;
using glsl::F;
using glsl::I;
using glsl::U;
using glsl::vec3;

// The shared files stand between two files of macros.
// clang-format off
namespace shared {
using namespace glsl;    // NOLINT: GLSL has no namespaces
using namespace shader;  // NOLINT

struct Cube {
#include "server/render/host/lanes/glsl-begin.h"
#include "shaders/glsl/cube.glsl"
#include "server/render/host/lanes/glsl-end.h"
};

struct View {
  // A copy, which stores into a frame cannot change.
  const ViewParams p;
  explicit View(const ViewParams& params) : p(params) {}
  HWY_INLINE F log2(F x) { return exact_log2(x); }
#include "server/render/host/lanes/glsl-begin.h"
#include "shaders/glsl/log2.glsl"
#include "shaders/glsl/view.glsl"
#include "server/render/host/lanes/glsl-end.h"
};
}  // namespace shared
// clang-format on

using shared::Cube;
using CubePlace = Cube::CubePlace;

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
