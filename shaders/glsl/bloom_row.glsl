// Bloom of the frame's texels, from level 0. The including shader declares BLOOM, LEVEL_SIZE, the texel buffer `bloom`
// and parameters with level_width and level_height.

// A row of B_0, interpolated along x at the four columns of a group.
struct BloomRow {
  vec3 c[GROUP_TEXELS];
};

BloomRow bloom_row(uint x, int y) {
  BloomRow row;
  if (BLOOM == BLOOM_NONE) return row;
  int at = clamp(y, 0, int(p.level_height) - 1) * int(p.level_width);
  vec3 t[4];
  if (LEVEL_SIZE == 4u) {
    int first = int(x / 4u) - 1;
    [[unroll]] for (int i = 0; i < 3; ++i)
      t[i] = fetch_rgb(bloom, at + clamp(first + i, 0, int(p.level_width) - 1));
    row.c[0] = 0.375 * t[0] + 0.625 * t[1];
    row.c[1] = 0.125 * t[0] + 0.875 * t[1];
    row.c[2] = 0.875 * t[1] + 0.125 * t[2];
    row.c[3] = 0.625 * t[1] + 0.375 * t[2];
  } else {
    int first = int(x / 2u) - 1;
    [[unroll]] for (int i = 0; i < 4; ++i)
      t[i] = fetch_rgb(bloom, at + clamp(first + i, 0, int(p.level_width) - 1));
    row.c[0] = 0.25 * t[0] + 0.75 * t[1];
    row.c[1] = 0.75 * t[1] + 0.25 * t[2];
    row.c[2] = 0.25 * t[1] + 0.75 * t[2];
    row.c[3] = 0.75 * t[2] + 0.25 * t[3];
  }
  return row;
}
