// Bloom, level n to level n+1: the 13-tap filter of docs/pipeline.md section 4.
//
// In: D_n. Out: D_{n+1}.
// Method: the 13 means of 2x2 texels are the sum of two separable filters, (1 2 1) x (1 2 1) on the means at
// even offsets and (1 1) x (1 1) on the means at offsets +-1. Along a row, with t0 .. t5 the texels from 2x -
// 2 on, they are
//   even = t0 + t1 + 2 (t2 + t3) + t4 + t5   and   odd = t1 + t2 + t3 + t4,
// and the same pattern applies down the rows. An invocation walks down BLOOM_ROWS rows and keeps the row sums
// that the next row needs too, so it reads each row once. Source: J. Jimenez, "Next Generation Post
// Processing in Call of Duty: Advanced Warfare", SIGGRAPH 2014.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"

layout(local_size_x = BLOOM_GROUP_X, local_size_y = BLOOM_GROUP_Y) in;
layout(set = 0, binding = 0) uniform utextureBuffer from;
layout(push_constant) uniform Push { BloomLevelParams p; };

struct RowSums {
  vec3 even;
  vec3 odd;
};

RowSums row_sums(uint x, int y) {
  int row = clamp(y, 0, int(p.from_height) - 1) * int(p.from_width);
  vec3 t[6];
  [[unroll]] for (int i = 0; i < 6; ++i)
    t[i] = fetch_rgb(from, row + clamp(int(2u * x) - 2 + i, 0, int(p.from_width) - 1));
  vec3 middle = t[2] + t[3];
  return RowSums(t[0] + t[1] + 2.0 * middle + t[4] + t[5], t[1] + middle + t[4]);
}

void main() {
  uint x = gl_GlobalInvocationID.x;
  uint first_row = gl_GlobalInvocationID.y * BLOOM_ROWS;
  if (x >= p.to_width || first_row >= p.to_height) return;

  int y2 = 2 * int(first_row);
  RowSums above = row_sums(x, y2 - 2);
  RowSums last = row_sums(x, y2 - 1);
  vec3 even_before = above.even + last.even;
  vec3 odd_before = last.odd;
  RowSums a = row_sums(x, y2);
  RowSums b = row_sums(x, y2 + 1);
  uint rows_end = min(first_row + BLOOM_ROWS, p.to_height);
  [[unroll]] for (uint i = 0u; i < BLOOM_ROWS; ++i) {
    uint y = first_row + i;
    if (y >= rows_end) break;
    RowSums c = row_sums(x, 2 * int(y) + 2);
    RowSums d = row_sums(x, 2 * int(y) + 3);
    vec3 even_here = a.even + b.even;
    vec3 even_after = c.even + d.even;
    vec3 even = even_before + 2.0 * even_here + even_after;
    vec3 odd = odd_before + a.odd + b.odd + c.odd;
    written[(y - p.first_row) * p.to_width + x] = level_words((0.03125 * 0.25) * even + (0.125 * 0.25) * odd);
    even_before = even_here;
    odd_before = b.odd;
    a = c;
    b = d;
  }
}
