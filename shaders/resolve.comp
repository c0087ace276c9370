// Phase B's last pass: reads the frame a second time and makes the image.
//
// In: the wire's pixels, B_0 (where BLOOM). Out: the image in OUTPUT's format.
// Method: docs/pipeline.md sections 4 and 5: scene + bloom, cut to 0, times E and prescale, curve, transfer,
// quantise. An invocation walks GROUP_TEXELS columns down RESOLVE_ROWS rows, two at a time; the bloom rows
// that the next pair shares stay in registers, filtered along x.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = RESOLVE_GROUP_X, local_size_y = RESOLVE_GROUP_Y) in;
layout(constant_id = 0) const uint PIXELS = PIXELS_RGBA16F;
layout(constant_id = 1) const bool MATRIX = false;
layout(constant_id = 2) const bool SCRUB = false;
layout(constant_id = 3) const bool BLOOM = true;
layout(constant_id = 4) const uint CURVE = CURVE_ACES_HILL;
layout(constant_id = 5) const uint TRANSFER = TRANSFER_SRGB;
layout(constant_id = 6) const uint OUTPUT = OUTPUT_RGBA8;

layout(set = 0, binding = 1) uniform utextureBuffer bloom;
layout(push_constant) uniform Push { ResolveParams p; };
#include "input.glsl"
#include "transfer.glsl"
#include "curves.glsl"

vec4 image_texel(vec4 wire, vec3 light) {
  vec4 scene = ingest(p.frame, wire);
  vec3 x = BLOOM ? scene.rgb + p.bloom_scale * light : scene.rgb;
  vec3 y = curve(at_most(at_least(x, 0.0) * p.exposure, MAX_EXPOSED_VALUE), p.curve_white);
  return vec4(OUTPUT == OUTPUT_RGBA16F ? y : encode(y), scene.a);
}

// Colour is in [0, 1] already.
uvec4 quantise(vec4 c, float codes) { return uvec4(vec4(c.rgb, at_most(at_least(c.a, 0.0), 1.0)) * codes + 0.5); }

uvec2 pack16(uvec4 v) { return v.xz | (v.yw << 16); }

uvec2 pack_texel(vec4 c) {
  if (OUTPUT == OUTPUT_RGBA16) return pack16(quantise(c, 65535.0));
  c = round_to_half(c);
  return uvec2(packHalf2x16(c.rg), packHalf2x16(c.ba));
}

void write(uint x, uint y, Group g) {
  OutWords words = OutWords(uvec2(p.output_lo, p.output_hi));
  uint at = y * p.output_pitch + x;
  if (OUTPUT == OUTPUT_RGBA8) {
    uvec4 v;
    [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) {
      uvec4 q = quantise(g.texel[i], 255.0);
      v[i] = q.r | (q.g << 8) | (q.b << 16) | (q.a << 24);
    }
    words[at / 4u].v = v;
  } else {
    words[at / 2u].v = uvec4(pack_texel(g.texel[0]), pack_texel(g.texel[1]));
    words[at / 2u + 1u].v = uvec4(pack_texel(g.texel[2]), pack_texel(g.texel[3]));
  }
}

// A row of B_0, sampled along x at the four columns of a group.
struct BloomRow {
  vec3 c[GROUP_TEXELS];
};

BloomRow bloom_row(uint x, int y) {
  BloomRow row;
  if (BLOOM) {
    int at = clamp(y, 0, int(p.level_height) - 1) * int(p.level_width);
    int first = int(x / 2u) - 1;
    vec3 t[4];
    [[unroll]] for (int i = 0; i < 4; ++i)
      t[i] = fetch_rgb(bloom, at + clamp(first + i, 0, int(p.level_width) - 1));
    row.c[0] = 0.25 * t[0] + 0.75 * t[1];
    row.c[1] = 0.75 * t[1] + 0.25 * t[2];
    row.c[2] = 0.25 * t[1] + 0.75 * t[2];
    row.c[3] = 0.75 * t[2] + 0.25 * t[3];
  }
  return row;
}

void resolve_row(uint x, uint y, BloomRow far, BloomRow near) {
  Group g = load_wire(p.frame, x, y);
  [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) {
    g.texel[i] = image_texel(g.texel[i], 0.25 * far.c[i] + 0.75 * near.c[i]);
  }
  write(x, y, g);
}

void main() {
  uint x = gl_GlobalInvocationID.x * GROUP_TEXELS;
  uint first_row = gl_GlobalInvocationID.y * RESOLVE_ROWS;
  if (x >= p.frame.width || first_row >= p.frame.height) return;

  BloomRow above = bloom_row(x, int(first_row / 2u) - 1);
  BloomRow here = bloom_row(x, int(first_row / 2u));
  uint rows_end = min(first_row + RESOLVE_ROWS, p.frame.height);
  for (uint y = first_row; y < rows_end; y += 2u) {
    BloomRow below = bloom_row(x, int(y / 2u) + 1);
    resolve_row(x, y, above, here);
    if (y + 1u < p.frame.height) resolve_row(x, y + 1u, below, here);
    above = here;
    here = below;
  }
}
