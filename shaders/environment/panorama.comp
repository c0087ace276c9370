// A panorama: the wire's pixels to the texels that an environment keeps.
//
// In: the wire's pixels. Out: RGBA halves, or with FLOATS floats, with alpha 1, and counts of what was wrong on
// the wire. Halves hold no light beyond +-65504; the host finds that in the counts and runs the pass again.
// Method: the ingest of a frame, always with the scrub, because a panorama is read once.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "glsl/common.glsl"
#include "environment/environment_params.h"

layout(local_size_x = ENVIRONMENT_GROUP) in;
layout(constant_id = 0) const uint PIXELS = PIXELS_RGBA16F;
layout(constant_id = 1) const bool MATRIX = false;
layout(constant_id = 2) const bool FLOATS = false;
const bool SCRUB = true;
layout(push_constant) uniform Push { PanoramaParams p; };
#include "glsl/input.glsl"

layout(buffer_reference, std430, buffer_reference_align = 4) buffer Counts { PanoramaCounts v; };

uint nan_components;
uint infinite_components;
uint negative_components;
uint clamped_components;
uint first_bad_inverted;
uint max_scene_bits;

void count(vec4 wire, uint texel) {
  bool bad = false;
  vec3 scene = ingest_unclamped(p.frame, wire).rgb;
  [[unroll]] for (uint i = 0u; i < 3u; ++i) {
    uint bits = floatBitsToUint(wire[i]);
    nan_components += uint(is_nan(wire[i]));
    infinite_components += uint(is_infinite(wire[i]));
    negative_components += uint(bits > 0x80000000u && bits <= 0xff800000u);
    uint clamped = uint(abs(wire[i]) > MAX_LIGHT && !is_infinite(wire[i]));
    if (MATRIX) clamped += uint(abs(scene[i]) > MAX_LIGHT);
    clamped_components += clamped;
    bad = bad || (bits & 0x7f800000u) == 0x7f800000u || clamped != 0u;
    max_scene_bits = max(max_scene_bits, floatBitsToUint(scene[i]) & 0x7fffffffu);
  }
  if (bad) first_bad_inverted = max(first_bad_inverted, ~texel);
}

u64vec2 float_words(vec4 wire) { return pack64(floatBitsToUint(vec4(ingest(p.frame, wire).rgb, 1.0))); }

uint64_t half_words_of(vec4 wire) {
  return pack_halves(clamp(ingest(p.frame, wire).rgb, -MAX_HALF, MAX_HALF));
}

void main() {
  uint at = gl_GlobalInvocationID.x;
  uint index = p.range.first + at;
  uint groups = p.frame.input_pitch / GROUP_TEXELS;
  uint y = index / groups;
  uint x = (index % groups) * GROUP_TEXELS;
  nan_components = 0u;
  infinite_components = 0u;
  negative_components = 0u;
  clamped_components = 0u;
  first_bad_inverted = 0u;
  max_scene_bits = 0u;
  if (at < p.range.count) {
    WireGroup wire = load_wire(p.frame, x, y);
    uint64_t texels[GROUP_TEXELS];
    [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) {
      bool inside = x + i < p.frame.width;
      vec4 texel = wire_texel(wire, i);
      if (inside) count(texel, y * p.frame.width + x + i);
      if (FLOATS) written[4u * at + i] = inside ? float_words(texel) : u64vec2(0ul);
      if (!FLOATS) texels[i] = inside ? half_words_of(texel) : 0ul;
    }
    if (!FLOATS) {
      written[2u * at] = u64vec2(texels[0], texels[1]);
      written[2u * at + 1u] = u64vec2(texels[2], texels[3]);
    }
  }
  uint nans = subgroupAdd(nan_components);
  uint infinite = subgroupAdd(infinite_components);
  uint negative = subgroupAdd(negative_components);
  uint clamped = subgroupAdd(clamped_components);
  uint first_bad = subgroupMax(first_bad_inverted);
  uint largest = subgroupMax(max_scene_bits);
  if (subgroupElect()) {
    Counts counts = Counts(uvec2(p.counts_lo, p.counts_hi));
    atomicAdd(counts.v.nan_components, nans);
    atomicAdd(counts.v.infinite_components, infinite);
    atomicAdd(counts.v.negative_components, negative);
    atomicAdd(counts.v.clamped_components, clamped);
    atomicMax(counts.v.first_bad_texel_inverted, first_bad);
    atomicMax(counts.v.max_scene_bits, largest);
  }
}
