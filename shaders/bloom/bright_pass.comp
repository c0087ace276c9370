// Bloom, level 0 from the frame: the first pass of phase B. It does not run without bloom.
//
// In: the wire's pixels. Out: one texel for each LEVEL_SIZE x LEVEL_SIZE texels of the frame, exactly 0 if
// none is bright.
// Method: docs/pipeline.md section 4. An invocation covers BRIGHT_STEPS blocks along x, each of GROUP_TEXELS
// columns and BRIGHT_ROWS rows of the frame. It reads neighbours in memory one after the other, so that
// processors prefetch them.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"

layout(local_size_x = BRIGHT_GROUP_X, local_size_y = BRIGHT_GROUP_Y) in;
layout(constant_id = 0) const uint PIXELS = PIXELS_RGBA16F;
layout(constant_id = 1) const bool MATRIX = false;
layout(constant_id = 2) const bool SCRUB = false;
layout(constant_id = 3) const uint BLOOM = BLOOM_MIP;
layout(constant_id = 4) const bool FIREFLY_WEIGHTS = true;
layout(constant_id = 5) const uint LEVEL_SIZE = 2u;  // 4 for means of 2x2 texels of D_0 and for GAUSSIAN
layout(constant_id = 6) const bool WHOLE = false;    // the width is a multiple of GROUP_TEXELS

layout(push_constant) uniform Push { BrightPassParams p; };
#include "glsl/input.glsl"

// A row of the scene with negatives cut to 0. Texels beyond the right edge repeat the last one; so do rows
// below the bottom.
Group scene_row(uint x, uint y) {
  WireGroup wire = load_wire(p.frame, x, min(y, p.frame.height - 1u));
  Group g;
  [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) g.texel[i].rgb = at_least(ingest(p.frame, wire_texel(wire, i)).rgb, 0.0);
  if (!WHOLE) {
    [[unroll]] for (uint i = 1u; i < GROUP_TEXELS; ++i) {
      if (x + i >= p.frame.width) g.texel[i] = g.texel[i - 1u];
    }
  }
  return g;
}

vec3 row_sum(Group g) { return (g.texel[0].rgb + g.texel[1].rgb) + (g.texel[2].rgb + g.texel[3].rgb); }

// D_0 of a 2x2 block.
vec3 level_texel(vec3 a, vec3 b, vec3 c, vec3 d) {
  if (BLOOM == BLOOM_CONSERVE) return 0.25 * (a + b + c + d);
  vec3 mean;
  if (FIREFLY_WEIGHTS) {
    vec4 k = 1.0 / (1.0 + vec4(luminance(a), luminance(b), luminance(c), luminance(d)));
    mean = (k.x * a + k.y * b + k.z * c + k.w * d) * (1.0 / (k.x + k.y + k.z + k.w));
  } else {
    mean = 0.25 * (a + b + c + d);
  }
  float l = luminance(mean);
  float over = l - p.threshold;
  float soft = at_most(at_least(over + p.knee, 0.0), 2.0 * p.knee);
  float q = p.knee > 0.0 ? soft * soft / (4.0 * p.knee) : 0.0;
  return mean * (at_least(over, q) / at_least(l, MIN_METERED_LUMINANCE));
}

// Two texels of D_0: those of columns x to x + 3 and rows y and y + 1.
struct Pair {
  vec3 left;
  vec3 right;
};

Pair level_texels(uint x, uint y) {
  Group top = scene_row(x, y);
  Group bottom = scene_row(x, y + 1u);
  return Pair(level_texel(top.texel[0].rgb, top.texel[1].rgb, bottom.texel[0].rgb, bottom.texel[1].rgb),
              level_texel(top.texel[2].rgb, top.texel[3].rgb, bottom.texel[2].rgb, bottom.texel[3].rgb));
}

// BLOOM_GAUSSIAN's texel of a 4x4 block.
vec3 gaussian_texel(uint x, uint y) {
  vec3 sum = (row_sum(scene_row(x, y)) + row_sum(scene_row(x, y + 1u))) +
             (row_sum(scene_row(x, y + 2u)) + row_sum(scene_row(x, y + 3u)));
  vec3 mean = sum * (1.0 / 16.0);
  return mean * at_most(at_least(luminance(mean) - p.threshold, 0.0), 1.0);
}

// Writes the texels of rows y to y + LEVEL_SIZE - 1.
void make_row(uint x, uint y) {
  uint at = (y / LEVEL_SIZE - p.first_row) * p.level_width + x / LEVEL_SIZE;
  if (BLOOM == BLOOM_GAUSSIAN) {
    written[at] = level_words(gaussian_texel(x, y));
  } else if (LEVEL_SIZE == 4u) {
    // The mean of 2x2 texels of D_0. Its last column and last row repeat at the edge.
    Pair top = level_texels(x, y);
    Pair bottom = level_texels(x, y + 2u < p.frame.height ? y + 2u : y);
    bool wide = WHOLE || x + 2u < p.frame.width;
    vec3 sum = (top.left + (wide ? top.right : top.left)) + (bottom.left + (wide ? bottom.right : bottom.left));
    written[at] = level_words(0.25 * sum);
  } else {
    Pair texels = level_texels(x, y);
    written[at] = level_words(texels.left);
    if (WHOLE || x + 2u < p.frame.width) written[at + 1u] = level_words(texels.right);
  }
}

void main() {
  uint first_row = gl_GlobalInvocationID.y * BRIGHT_ROWS;
  uint rows_end = min(first_row + BRIGHT_ROWS, p.frame.height);
  uint block = BRIGHT_GROUP_X * GROUP_TEXELS;
  uint x = gl_WorkGroupID.x * BRIGHT_STEPS * block + gl_LocalInvocationID.x * GROUP_TEXELS;
  uint x_end = min(x + BRIGHT_STEPS * block, p.frame.width);
  for (; x < x_end; x += block) {
    [[unroll]] for (uint i = 0u; i < BRIGHT_ROWS; i += LEVEL_SIZE) {
      if (first_row + i >= rows_end) break;
      make_row(x, first_row + i);
    }
  }
}
