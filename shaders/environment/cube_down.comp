// A cube map's chain, from one level to the next.
//
// In: a level with its border. Out: the next one, half as large, with its border.
// Method: docs/environments.md section 2: the mean of 2 x 2 texels by their solid angles. A texel's solid
// angle is the integral of (1 + s^2 + t^2)^(-3/2) over it. A Gaussian quadrature of 3 x 3 points makes it,
// because the difference of four values of A would cancel in floats. The fourth word says where in the texel
// its light is, from -1 to 1 in s and t, for cube_specular. In a border it means nothing.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"
#include "glsl/environment.glsl"

layout(local_size_x = ENVIRONMENT_GROUP) in;
layout(set = 0, binding = 0) uniform utextureBuffer chain;
layout(push_constant) uniform Push { CubeDownParams p; };

// Proportional to the solid angle of texel (i, j) of the level with `size` texels a side.
float solid_angle(int i, int j, int size) {
  const float points[3] = {-0.774596669, 0.0, 0.774596669};
  const float weights[3] = {0.625, 1.0, 0.625};
  float scale = 1.0 / float(size);
  float s = float(2 * i + 1 - size);
  float t = float(2 * j + 1 - size);
  float sum = 0.0;
  [[unroll]] for (int b = 0; b < 3; ++b) {
    float y = (t + points[b]) * scale;
    [[unroll]] for (int a = 0; a < 3; ++a) {
      float x = (s + points[a]) * scale;
      float distance = 1.0 + x * x + y * y;
      sum += weights[a] * weights[b] / (distance * sqrt(distance));
    }
  }
  return sum;
}

// The mean, and where the texel's light is: 2 x 16 bits.
uvec4 texel_mean(CubeTexel texel) {
  uint size = 2u * p.size;
  uint pitch = size + 2u;
  vec3 sum = vec3(0.0);
  float weights = 0.0;
  vec2 moment = vec2(0.0);
  float light = 0.0;
  [[unroll]] for (int b = 0; b < 2; ++b) {
    [[unroll]] for (int a = 0; a < 2; ++a) {
      int i = 2 * texel.i + a;
      int j = 2 * texel.j + b;
      float weight = solid_angle(i, j, int(size));
      uvec4 words = texelFetch(chain, int(p.from + (texel.face * pitch + uint(j + 1)) * pitch + uint(i + 1)));
      vec3 part = weight * uintBitsToFloat(words.rgb);
      float size_of_part = abs(part.r) + abs(part.g) + abs(part.b);
      sum += part;
      weights += weight;
      moment += size_of_part * (vec2(a, b) - 0.5 + 0.5 * unpackSnorm2x16(words.a));
      light += size_of_part;
    }
  }
  vec2 centre = light > 0.0 ? moment / light : vec2(0.0);
  return uvec4(floatBitsToUint(sum / weights), packSnorm2x16(centre));
}

void main() {
  uint at = gl_GlobalInvocationID.x;
  if (at >= p.range.count) return;
  CubeTexel texel = bordered_texel(p.range.first + at, p.size);
  uint count = sources(texel, p.size);
  vec3 sum = vec3(0.0);
  uint centre;
  for (uint k = 0u; k < count; ++k) {
    uvec4 words = texel_mean(source(texel, k, p.size));
    sum += uintBitsToFloat(words.rgb);
    centre = words.a;
  }
  written[at] = pack64(uvec4(floatBitsToUint(sum / float(count)), centre));
}
