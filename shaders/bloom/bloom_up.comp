// Bloom, level n+1 to level n: adds the tent-filtered coarser level to the finer one in place
// (docs/pipeline.md section 4).
//
// In: B_{n+1} (from), D_n (to_before). Out: B_n = FINE_WEIGHT * D_n + U_n(B_{n+1}), in the memory of D_n.
// Method: (1 2 1)/4 over bilinear samples at x -+ 0.25 is a 4-tap filter along each axis: (1 5 7 3)/16 from x
// - 2 on for even texels and (3 7 5 1)/16 from x - 1 on for odd ones. An invocation makes two columns, walks
// down BLOOM_ROWS pairs of rows, and keeps the filtered rows that the next pair needs too.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"

layout(local_size_x = BLOOM_GROUP_X, local_size_y = BLOOM_GROUP_Y) in;
layout(constant_id = 0) const float FINE_WEIGHT = 1.0;  // weight of D_n; 2 if it also stands for a finer level
layout(set = 0, binding = 0) uniform utextureBuffer from;
// The same memory as `written`. An invocation reads only the texels that it writes, before it writes them.
layout(set = 0, binding = 1) uniform utextureBuffer to_before;
layout(push_constant) uniform Push { BloomLevelParams p; };

// A coarse row, filtered along x at the even and at the odd fine column.
struct Row {
  vec3 even;
  vec3 odd;
};

Row filtered_row(uint x, int y) {
  int row = clamp(y, 0, int(p.from_height) - 1) * int(p.from_width);
  vec3 t[5];
  [[unroll]] for (int i = 0; i < 5; ++i)
    t[i] = fetch_rgb(from, row + clamp(int(x) - 2 + i, 0, int(p.from_width) - 1));
  return Row(0.0625 * t[0] + 0.3125 * t[1] + 0.4375 * t[2] + 0.1875 * t[3],
             0.1875 * t[1] + 0.4375 * t[2] + 0.3125 * t[3] + 0.0625 * t[4]);
}

void add(uint x, uint y, vec3 c) {
  vec3 before = fetch_rgb(to_before, int(y * p.to_width + x));
  written[(y - p.first_row) * p.to_width + x] = level_words(FINE_WEIGHT * before + c);
}

void main() {
  uint x = gl_GlobalInvocationID.x;
  uint first_row = gl_GlobalInvocationID.y * BLOOM_ROWS;
  uint row_pairs = (p.to_height + 1u) / 2u;
  if (2u * x >= p.to_width || first_row >= row_pairs) return;

  Row a = filtered_row(x, int(first_row) - 2);
  Row b = filtered_row(x, int(first_row) - 1);
  Row c = filtered_row(x, int(first_row));
  Row d = filtered_row(x, int(first_row) + 1);
  bool odd_column = 2u * x + 1u < p.to_width;
  uint rows_end = min(first_row + BLOOM_ROWS, row_pairs);
  [[unroll]] for (uint i = 0u; i < BLOOM_ROWS; ++i) {
    uint y = first_row + i;
    if (y >= rows_end) break;
    Row e = filtered_row(x, int(y) + 2);
    add(2u * x, 2u * y, 0.0625 * a.even + 0.3125 * b.even + 0.4375 * c.even + 0.1875 * d.even);
    if (odd_column)
      add(2u * x + 1u, 2u * y, 0.0625 * a.odd + 0.3125 * b.odd + 0.4375 * c.odd + 0.1875 * d.odd);
    if (2u * y + 1u < p.to_height) {
      add(2u * x, 2u * y + 1u, 0.1875 * b.even + 0.4375 * c.even + 0.3125 * d.even + 0.0625 * e.even);
      if (odd_column)
        add(2u * x + 1u, 2u * y + 1u, 0.1875 * b.odd + 0.4375 * c.odd + 0.3125 * d.odd + 0.0625 * e.odd);
    }
    a = b;
    b = c;
    c = d;
    d = e;
  }
}
