// An image of another size: one of the two passes that make its scene of the frame's light.
//
// In: along y the wire's pixels and B_0 (unless BLOOM is BLOOM_NONE), along x the block of rows that the pass along y
// made; and the weights of both axes. Out: a block of the image's rows and the frame's columns, or those rows of the
// resized scene; four floats a texel.
// Method: docs/pipeline.md section 5. Along y an invocation makes GROUP_TEXELS texels of a row, along x one.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"

layout(local_size_x = RESIZE_GROUP_X, local_size_y = 1) in;
layout(constant_id = 0) const uint PIXELS = PIXELS_RGBA16F;
layout(constant_id = 1) const bool MATRIX = false;
layout(constant_id = 2) const bool SCRUB = false;
layout(constant_id = 3) const uint BLOOM = BLOOM_MIP;
layout(constant_id = 4) const uint LEVEL_SIZE = 2u;
layout(constant_id = 5) const bool WIDE = false;
layout(constant_id = 6) const bool UNROUNDED = false;
layout(constant_id = 7) const bool DOWN = true;

layout(set = 0, binding = 1) uniform utextureBuffer bloom;
layout(set = 0, binding = 2) uniform utextureBuffer weights;
layout(push_constant) uniform Push { ResizeParams p; };
#include "glsl/input.glsl"
#include "glsl/bloom_row.glsl"

const float FAR = 3.0e38;  // beyond any light

// Texels x <= k < y of the axis that are nearer to output i than `lobes` units. All products are below 2^31.
uvec2 within(uint i, int lobes) {
  int step = 2 * int(p.to);
  int centre = (2 * int(i) + 1) * int(p.from) - int(p.to);
  int reach = lobes * 2 * int(max(p.from, p.to));
  int below = centre - reach;
  int first = below < 0 ? 0 : below / step + 1;
  int last = min((centre + reach - 1) / step + 1, int(p.from));
  return uvec2(first, last);
}

struct Sums {
  vec4 sum;
  vec4 low;
  vec4 high;
};

Sums no_sums() { return Sums(vec4(0.0), vec4(FAR), vec4(-FAR)); }

void add(inout Sums s, vec4 light, float weight, bool main_lobe) {
  s.sum += weight * light;
  if (main_lobe) {
    s.low = min(s.low, light);
    s.high = max(s.high, light);
  }
}

vec4 finished(Sums s) {
  return p.mean > 0u ? s.sum / float(p.mean) : min(max(s.sum, s.low), s.high);
}

float weight_at(uint index) { return uintBitsToFloat(texelFetch(weights, int(index / 4u))[index % 4u]); }

// The frame's light with its bloom, at GROUP_TEXELS columns of a row.
Group light_group(uint x, uint y) {
  WireGroup wire = load_wire(p.frame, x, y);
  uint part = y % LEVEL_SIZE;
  int row = int(y / LEVEL_SIZE);
  BloomRow near = bloom_row(x, row);
  BloomRow far = bloom_row(x, part < LEVEL_SIZE / 2u ? row - 1 : row + 1);
  float near_weight = LEVEL_SIZE == 2u ? 0.75 : part == 0u || part == 3u ? 0.625 : 0.875;
  Group g;
  [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) {
    vec4 texel = wire_texel(wire, i);
    vec4 scene = UNROUNDED ? ingest_unrounded(p.frame, texel)
                 : WIDE    ? ingest_wide(p.frame, texel)
                           : ingest(p.frame, texel);
    if (BLOOM == BLOOM_CONSERVE) scene.rgb *= p.scene_scale;
    if (BLOOM != BLOOM_NONE) {
      scene.rgb += p.bloom_scale * ((1.0 - near_weight) * far.c[i] + near_weight * near.c[i]);
    }
    g.texel[i] = scene;
  }
  return g;
}

void write(uint x, uint row, vec4 light) {
  written[(row - p.first_row) * p.to_pitch + x] = pack64(floatBitsToUint(light));
}

void main() {
  uint row = gl_GlobalInvocationID.y;
  uint x = gl_GlobalInvocationID.x * (DOWN ? GROUP_TEXELS : 1u);
  if (x >= (DOWN ? p.frame.width : p.to)) return;
  uint i = DOWN ? p.block_row + row : x;  // the output along the axis
  uvec2 range = p.mean > 0u ? uvec2(i, i + 1u) * p.mean : within(i, 3);
  uvec2 lobe = p.mean > 0u ? uvec2(0u) : within(i, 1);
  uint count = DOWN ? GROUP_TEXELS : 1u;
  Sums sums[GROUP_TEXELS];
  for (uint n = 0u; n < count; ++n) sums[n] = no_sums();
  for (uint k = range.x; k < range.y; ++k) {
    float weight = p.mean > 0u ? 1.0 : weight_at(p.weights + i * p.taps + k - range.x);
    bool main_lobe = k >= lobe.x && k < lobe.y;
    if (DOWN) {
      Group g = light_group(x, k);
      [[unroll]] for (uint n = 0u; n < GROUP_TEXELS; ++n) add(sums[n], g.texel[n], weight, main_lobe);
    } else {
      uint at = (row - p.block_row) * p.from_pitch + k;
      add(sums[0], uintBitsToFloat(texelFetch(wire_words, int(at))), weight, main_lobe);
    }
  }
  for (uint n = 0u; n < count; ++n) write(x + n, row, finished(sums[n]));
}
