// AgX's base curve with the power that makes it light (docs/pipeline.md section 5), for each target of
// Highway.
//
// curves.glsl takes two logarithms, two exponentials and two square roots of each component for it. Both
// together are a function of one number from 0 to 1. Here sixteen polynomials make it, whose coefficients a
// vector register holds.
#if defined(CANDELA_HOST_AGX_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_AGX_INL_H
#undef CANDELA_HOST_AGX_INL_H
#else
#define CANDELA_HOST_AGX_INL_H
#endif

#include <hwy/highway.h>

#include <array>

#include "server/render/host/lanes/glsl-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// The coefficient of v^k of piece j is kAgxPieces[k][j].
alignas(64) inline constexpr std::array<float, 16> kAgxPieces[6] = {
    {{-9.441061e-06f, 2.0318207e-06f, 3.0163432e-05f, 1.5961051e-04f, 6.4403465e-04f, 0.00236641f,
      0.008286133f, 0.026694747f, 0.07273542f, 0.15889727f, 0.2866043f, 0.45288995f, 0.6369307f, 0.7980297f,
      0.91106844f, 0.98058844f}},
    {{1.02327176e-04f, 8.551533e-06f, 5.842577e-05f, 2.3670345e-04f, 8.5846963e-04f, 0.0030217285f,
      0.010136632f, 0.029386088f, 0.06501644f, 0.10723384f, 0.14815158f, 0.18106575f, 0.17939688f,
      0.13837136f, 0.08892889f, 0.052816436f}},
    {{-4.387103e-04f, 1.16580695e-05f, 4.4587363e-05f, 1.5606276e-04f, 5.447783e-04f, 0.0018800057f,
      0.0058764187f, 0.013900682f, 0.02071658f, 0.02067997f, 0.020190015f, 0.010042274f, -0.012332593f,
      -0.025505306f, -0.022101328f, -0.014085572f}},
    {{9.3263586e-04f, 5.7845023e-06f, 1.8863242e-05f, 6.4887456e-05f, 2.2728386e-04f, 7.592826e-04f,
      0.0020304874f, 0.0030118774f, 0.001064773f, -4.9679296e-04f, -9.0862636e-04f, -0.0061126393f,
      -0.007254303f, -0.0011326314f, 0.0025461195f, 0.002458659f}},
    {{-9.882797e-04f, 1.5501578e-06f, 5.862189e-06f, 2.068641e-05f, 7.208365e-05f, 2.1695279e-04f,
      3.8275245e-04f, -7.571099e-05f, -6.97021e-04f, 1.2877847e-04f, -9.437572e-04f, -0.0012353949f,
      9.084133e-04f, 0.0015179014f, 3.214421e-04f, -2.064441e-04f}},
    {{4.2141398e-04f, 5.8218257e-07f, 1.4664763e-06f, 5.2338946e-06f, 1.7435394e-05f, 4.0703446e-05f,
      9.900097e-08f, -1.801769e-04f, 2.0465883e-05f, 2.4018413e-04f, -2.2531445e-04f, 2.1112784e-04f,
      4.44038e-04f, -1.8242215e-04f, -1.9703714e-04f, -3.63401e-05f}}};

// The light, 0 to 1, of agx_stops() x. The curve's second half begins at 10/16.5, where a piece begins, too.
// fit: 16 pieces, degree 5, error 6.7e-08, best 5.6e-08
HWY_INLINE F agx_shaped(F x) {
  const F at = x * 15.0 + (10.0 - 15.0 * 10.0 / 16.5);
  const glsl::I piece(at);
  const U index(piece);
  const F v = (at - F(piece)) - 0.5;
  F y = look_up(kAgxPieces[5], index.v);
  for (size_t k = 5; k-- > 0;) y = y * v + F(look_up(kAgxPieces[k], index.v));
  return min(max(y, 0.0), 1.0);
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
