// A specular level of a cube map.
//
// In: the chain, whose texels also say where in them their light is. Out: the level with its border, four
// floats a texel.
// Method: docs/environments.md section 4: the sum of L k over the texels of the chain, divided by that of k.
// From each face downwards a texel is taken whole if it is small beside the distance over which k changes,
// otherwise its four texels in the next finer level are. The walk needs no stack: `code` is the texel's face
// and the bits of its column and row in turn.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"
#include "glsl/environment.glsl"

layout(local_size_x = ENVIRONMENT_GROUP) in;
layout(set = 0, binding = 0) uniform utextureBuffer chain;
layout(push_constant) uniform Push { CubeSpecularParams p; };

// Bits 0, 2, 4 .. of a number below 2^24.
uint even_bits(uint x) {
  x &= 0x00555555u;
  x = (x | (x >> 1)) & 0x00333333u;
  x = (x | (x >> 2)) & 0x000f0f0fu;
  x = (x | (x >> 4)) & 0x00ff00ffu;
  return (x | (x >> 8)) & 0x0000ffffu;
}

// k(c), up to a constant.
float lobe(float c) {
  float h2 = 0.5 + 0.5 * c;
  float d = h2 * (p.alpha2 - 1.0) + 1.0;
  return max(c, 0.0) / (d * d);
}

vec3 texel_mean(CubeTexel texel) {
  vec3 n = texel_direction(texel, p.size);
  vec3 light = vec3(0.0);
  float total = 0.0;
  uint code = 0u;
  uint depth = 0u;
  while (depth > 0u || code < 6u) {
    uint size = 1u << depth;
    uint face = code >> (2u * depth);
    uint within = code & (size * size - 1u);
    uint i = even_bits(within);
    uint j = even_bits(within >> 1);
    float half_side = 1.0 / float(size);
    float s = float(int(2u * i + 1u) - int(size)) * half_side;
    float t = float(int(2u * j + 1u) - int(size)) * half_side;
    float q = 1.0 / (1.0 + s * s + t * t);
    float cosine = dot(n, face_direction(face, s, t)) * sqrt(q);
    float side2 = 4.0 * half_side * half_side * q;
    // D changes over sqrt(theta^2 + 4 alpha^2), and the cosine over 1.
    float scale2 = min(2.0 * (1.0 - cosine) + 4.0 * p.alpha2, 1.0);
    bool hidden = cosine < 0.0 && cosine * cosine > side2;
    bool whole = hidden || depth == p.chain_last || side2 <= p.detail2 * scale2;
    if (whole) {
      uint pitch = size + 2u;
      uint level = p.chain_last - depth;
      uint at = CUBE_LEVEL_START(p.chain_size, size, level) + (face * pitch + j + 1u) * pitch + i + 1u;
      uvec4 words = texelFetch(chain, int(at));
      vec2 offset = unpackSnorm2x16(words.a) * half_side;
      vec3 d = face_direction(face, s + offset.x, t + offset.y);
      float solid_angle = half_side * half_side * q * sqrt(q) *
                          (1.0 + half_side * half_side * q * (1.5 - 2.5 * q));
      float weight = solid_angle * lobe(dot(n, d) * inversesqrt(dot(d, d)));
      light += uintBitsToFloat(words.rgb) * weight;
      total += weight;
      code += 1u;
      uint up = min(uint(findLSB(code)) / 2u, depth);
      code >>= 2u * up;
      depth -= up;
    } else {
      code <<= 2u;
      depth += 1u;
    }
  }
  return light / total;
}

void main() {
  uint at = gl_GlobalInvocationID.x;
  if (at >= p.range.count) return;
  CubeTexel texel = bordered_texel(p.range.first + at, p.size);
  uint count = sources(texel, p.size);
  vec3 sum = vec3(0.0);
  for (uint k = 0u; k < count; ++k) sum += texel_mean(source(texel, k, p.size));
  written[at] = level_words(sum / float(count));
}
