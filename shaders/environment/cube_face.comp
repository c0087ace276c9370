// Level 0 of a cube map, from a panorama.
//
// In: the panorama. Out: the level with its border, four floats a texel.
// Method: docs/environments.md section 2: the mean of P at the centres of K x K sub-texels. A border texel
// is computed like the texel that it stands for, and so has its bits. The fourth word says where in the
// texel its light is, for cube_specular; in a border it means nothing.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"
#include "glsl/environment.glsl"

layout(local_size_x = ENVIRONMENT_GROUP) in;
layout(constant_id = 0) const bool FLOATS = false;
layout(set = 0, binding = 0) uniform utextureBuffer panorama;
layout(push_constant) uniform Push { CubeFaceParams p; };

// The mean, and where in the texel its light is: 2 x 16 bits, from -1 to 1 in s and t.
uvec4 texel_mean(CubeTexel texel) {
  float scale = 1.0 / float(p.size * p.samples);
  int first_s = 2 * texel.i * int(p.samples) + 1 - int(p.size * p.samples);
  int first_t = 2 * texel.j * int(p.samples) + 1 - int(p.size * p.samples);
  float within = 1.0 / float(p.samples);
  vec3 sum = vec3(0.0);
  vec2 moment = vec2(0.0);
  float light = 0.0;
  for (uint b = 0u; b < p.samples; ++b) {
    vec3 row = vec3(0.0);
    float row_light = 0.0;
    float row_moment = 0.0;
    float t = float(first_t + 2 * int(b)) * scale;
    for (uint a = 0u; a < p.samples; ++a) {
      float s = float(first_s + 2 * int(a)) * scale;
      vec3 c = panorama_at(panorama, FLOATS, p.panorama, face_direction(texel.face, s, t));
      float size_of_c = abs(c.r) + abs(c.g) + abs(c.b);
      row += c;
      row_light += size_of_c;
      row_moment += size_of_c * (float(2u * a + 1u) * within - 1.0);
    }
    sum += row;
    light += row_light;
    moment += vec2(row_moment, row_light * (float(2u * b + 1u) * within - 1.0));
  }
  vec2 centre = light > 0.0 ? moment / light : vec2(0.0);
  return uvec4(floatBitsToUint(sum * (within * within)), packSnorm2x16(centre));
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
