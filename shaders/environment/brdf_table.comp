// The BRDF table: scale and bias by n.v and roughness.
//
// Out: pairs of halves, four of a row in 16 bytes.
// Method: docs/environments.md section 5, as an integral over half vectors. The polar angle is drawn from D
// (n.h) by u = 1 - (1 - x)^4, which puts points where the lobe ends. At each one only the angles around n at
// which l is above the surface are integrated, with more points where it is just above: phi = end (1 - y^2).
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"
#include "glsl/environment.glsl"

layout(local_size_x = ENVIRONMENT_GROUP) in;
layout(push_constant) uniform Push { BrdfTableParams p; };

const float PI = 3.14159265;

// The angle whose cosine is c, -1 <= c <= 1, in radians.
float angle_of(float c) {
  float s = sqrt(max(1.0 - c * c, 0.0));
  float turns = small_angle(abs(c), s);
  if (s > abs(c)) return 2.0 * PI * (0.25 - (c < 0.0 ? -turns : turns));
  return 2.0 * PI * (c < 0.0 ? 0.5 - turns : turns);
}

// (scale, bias) from one polar angle of h: cosine c and sine s.
vec2 around(float nov, float sin_v, float alpha2, float c, float s) {
  float reach = 2.0 * c * sin_v * s;
  float end = angle_of(clamp(nov * (1.0 - 2.0 * c * c) / max(reach, 1e-30), -1.0, 1.0));
  float across_v = sqrt(nov * nov * (1.0 - alpha2) + alpha2);
  vec2 sum = vec2(0.0);
  for (uint k = 0u; k < BRDF_ROUND_POINTS; ++k) {
    float y = 1.0 - (float(k) + 0.5) / float(BRDF_ROUND_POINTS);
    float voh = sin_v * s * cos(end * (1.0 - y * y)) + nov * c;
    float nol = min(2.0 * voh * c - nov, 1.0);
    bool above = voh > 0.0 && nol > 0.0;
    float visible = 0.5 / max(nol * across_v + nov * sqrt(nol * nol * (1.0 - alpha2) + alpha2), 1e-30);
    float light = above ? visible * nol * 4.0 * voh / c * 2.0 * y : 0.0;
    float m = 1.0 - min(voh, 1.0);
    float fresnel = m * m * m * m * m;
    sum += light * vec2(1.0 - fresnel, fresnel);
  }
  return sum * (end / (PI * float(BRDF_ROUND_POINTS)));
}

vec2 pair_at(uint x, uint y) {
  float nov = (float(x) + 0.5) / float(BRDF_SIZE);
  float roughness = (float(y) + 0.5) / float(BRDF_SIZE);
  float alpha2 = roughness * roughness * roughness * roughness;
  float sin_v = sqrt(1.0 - nov * nov);
  vec2 sum = vec2(0.0);
  for (uint k = 0u; k < BRDF_POLAR_POINTS; ++k) {
    float m = 1.0 - (float(k) + 0.5) / float(BRDF_POLAR_POINTS);
    float left = m * m * m * m;  // 1 - u
    float tan2 = alpha2 * (1.0 - left) / left;
    float c = inversesqrt(1.0 + tan2);
    sum += 4.0 * m * m * m * around(nov, sin_v, alpha2, c, sqrt(tan2) * c);
  }
  return sum / float(BRDF_POLAR_POINTS);
}

void main() {
  uint at = gl_GlobalInvocationID.x;
  if (at >= p.range.count) return;
  uint index = 4u * (p.range.first + at);
  uvec4 words;
  [[unroll]] for (uint i = 0u; i < 4u; ++i) {
    vec2 pair = pair_at(index % BRDF_SIZE + i, index / BRDF_SIZE);
    words[i] = half_bits(pair.x) | (half_bits(pair.y) << 16);
  }
  written[at] = pack64(words);
}
