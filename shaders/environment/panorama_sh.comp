// Spherical harmonics of a panorama: sums along its rows.
//
// In: the panorama, and for each column the integrals of sin lon, cos lon, sin 2 lon and cos 2 lon over it.
// Out: SH_PARTS partial sums for each row, 16 floats each: R, G and B of the plain sum and of the sums with
// these four factors.
// Method: docs/environments.md section 3. Part k of a row has the pairs of texels k, k + SH_PARTS and so on,
// from left to right. The host adds the parts and rows in double, in a fixed order.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"
#include "glsl/environment.glsl"

layout(local_size_x = ENVIRONMENT_GROUP) in;
layout(constant_id = 0) const bool FLOATS = false;
layout(set = 0, binding = 0) uniform utextureBuffer panorama;
layout(set = 0, binding = 1) uniform utextureBuffer columns;
layout(push_constant) uniform Push { PanoramaShParams p; };

vec3 sums[5];

vec3 of_halves(uvec2 words) { return vec3(unpackHalf2x16(words.x), unpackHalf2x16(words.y).x); }
vec3 of_floats(uint at) { return uintBitsToFloat(texelFetch(panorama, int(at)).rgb); }

// Texels beyond the width are 0.
void add(vec3 texel, uint x) {
  vec4 factors = uintBitsToFloat(texelFetch(columns, int(min(x, p.panorama.width - 1u))));
  sums[0] += texel;
  [[unroll]] for (uint i = 0u; i < 4u; ++i) sums[i + 1u] += texel * factors[i];
}

void main() {
  uint at = gl_GlobalInvocationID.x;
  if (at >= p.range.count) return;
  uint index = p.range.first + at;
  uint row = index / SH_PARTS * p.panorama.pitch;
  [[unroll]] for (uint i = 0u; i < 5u; ++i) sums[i] = vec3(0.0);
  for (uint x = 2u * (index % SH_PARTS); x < p.panorama.width; x += 2u * SH_PARTS) {
    if (FLOATS) {
      add(of_floats(row + x), x);
      add(of_floats(row + x + 1u), x + 1u);
    } else {
      uvec4 words = texelFetch(panorama, int((row + x) / 2u));
      add(of_halves(words.xy), x);
      add(of_halves(words.zw), x + 1u);
    }
  }
  written[4u * at] = pack64(floatBitsToUint(vec4(sums[0], sums[1].r)));
  written[4u * at + 1u] = pack64(floatBitsToUint(vec4(sums[1].gb, sums[2].rg)));
  written[4u * at + 2u] = pack64(floatBitsToUint(vec4(sums[2].b, sums[3])));
  written[4u * at + 3u] = pack64(floatBitsToUint(vec4(sums[4], 0.0)));
}
