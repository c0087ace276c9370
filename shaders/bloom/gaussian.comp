// Gaussian bloom: one direction of the separable 13-tap kernel of docs/pipeline.md section 4.
//
// In: the first pass (VERTICAL) reads D, a quarter of the frame's width and height; the second pass reads the
// first one's result and filters along the rows. Out: a level of the same size.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"

layout(local_size_x = BLOOM_GROUP_X, local_size_y = BLOOM_GROUP_Y) in;
layout(constant_id = 0) const bool VERTICAL = true;
layout(set = 0, binding = 0) uniform utextureBuffer from;
layout(push_constant) uniform Push { GaussianParams p; };

vec3 tap(int x, int y) {
  int at = clamp(y, 0, int(p.height) - 1) * int(p.width) + clamp(x, 0, int(p.width) - 1);
  return fetch_rgb(from, at);
}

vec3 pair(int x, int y, int i) {
  return VERTICAL ? tap(x, y - i) + tap(x, y + i) : tap(x - i, y) + tap(x + i, y);
}

void main() {
  uint x = gl_GlobalInvocationID.x;
  uint first_row = gl_GlobalInvocationID.y * BLOOM_ROWS;
  if (x >= p.width || first_row >= p.height) return;
  uint rows_end = min(first_row + BLOOM_ROWS, p.height);
  for (uint row = first_row; row < rows_end; ++row) {
    int y = int(row);
    vec3 sum = 0.199471 * tap(int(x), y);
    sum += 0.176033 * pair(int(x), y, 1);
    sum += 0.120985 * pair(int(x), y, 2);
    sum += 0.064759 * pair(int(x), y, 3);
    sum += 0.026995 * pair(int(x), y, 4);
    sum += 0.008764 * pair(int(x), y, 5);
    sum += 0.002216 * pair(int(x), y, 6);
    written[(row - p.first_row) * p.width + x] = level_words(sum * (1.0 / 0.998975));
  }
}
