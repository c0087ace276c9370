// Transfer functions: display-linear light to display values (docs/pipeline.md section 5). Source of sRGB: IEC 61966-2-1.
//
// The including shader declares TRANSFER and TRANSFER_TERMS, the number of terms of the sRGB polynomial, DISPLAY,
// and the parameters p. This file is C++, too: server/render/host/lanes-inl.h says what that asks for.
// log2.glsl says how a polynomial states its fit.
#include "log2.glsl"
#include "hdr.glsl"

// The short form, with 6 terms: 1.055 x^(1/2.4) - 0.055 in s = x^(1/2). Errors are in 8-bit codes.
// fit: s in [0.0559536, 1], degree 5, error 8.3e-02, best 8.3e-02
vec3 srgb_6(vec3 x) {
  vec3 s = sqrt(x);
  vec3 high = s * 0.51730651 - 1.62366843;
  high = high * s + 2.03158426;
  high = high * s - 1.40274048;
  high = high * s + 1.51795166;
  high = high * s - 0.0401096568;
  return mix(at_most(high, 1.0), 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

// The full form, with 8 terms: 1.055 x^(1/2.4) - 0.055 in s = x^(1/4). Errors are in 8-bit codes.
// fit: s in [0.236545, 1], degree 7, error 1.0e-04, best 8.2e-05
vec3 srgb(vec3 x) {
  if (TRANSFER_TERMS == 6u) return srgb_6(x);
  vec3 s = sqrt(sqrt(x));
  vec3 high = s * -0.0763354301 + 0.395272791;
  high = high * s - 0.899455428;
  high = high * s + 1.21019661;
  high = high * s - 1.15650499;
  high = high * s + 1.46173096;
  high = high * s + 0.123538949;
  high = high * s - 0.0584438555;
  return mix(high, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

vec3 encode(vec3 y) {
  if (TRANSFER == TRANSFER_SRGB) return srgb(y);
  if (TRANSFER == TRANSFER_GAMMA22) return vec3(power(y.r, 1.0 / 2.2), power(y.g, 1.0 / 2.2), power(y.b, 1.0 / 2.2));
  if (TRANSFER == TRANSFER_PQ) {
    vec3 light = y * p.display_peak;
    return vec3(pq(light.r), pq(light.g), pq(light.b));
  }
  if (TRANSFER == TRANSFER_HLG) return hlg(y, p.hlg_exponent);
  return y;
}
