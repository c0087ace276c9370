// The image, the last pass of phase B: reads the frame a second time and writes the rendered image.
//
// In: the wire's pixels or the resized scene, B_0 (unless BLOOM is BLOOM_NONE), the table if the curve has one, and
// the pieces of the gain map if there is one. Out: the image in the format OUTPUT.
// Method: docs/pipeline.md sections 4 and 5: scene plus bloom, times E and prescale, tone curve, transfer,
// dither, quantisation. Only a frame with negative components (WIDE) has something that the curve can cut; it
// counts that. An invocation makes RESOLVE_STEPS blocks along x, each of
// GROUP_TEXELS columns and RESOLVE_ROWS rows. It reads neighbours in memory one after the other, so that
// processors prefetch them. The bloom rows that two rows of a block share stay in registers, already filtered
// along x.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "glsl/common.glsl"

layout(local_size_x = RESOLVE_GROUP_X, local_size_y = RESOLVE_GROUP_Y) in;
layout(constant_id = 0) const uint PIXELS = PIXELS_RGBA16F;
layout(constant_id = 1) const bool MATRIX = false;
layout(constant_id = 2) const bool SCRUB = false;
layout(constant_id = 3) const uint BLOOM = BLOOM_MIP;
layout(constant_id = 4) const uint CURVE = CURVE_ACES_HILL;
layout(constant_id = 5) const uint TRANSFER = TRANSFER_SRGB;
layout(constant_id = 6) const uint OUTPUT = OUTPUT_RGBA8;
layout(constant_id = 7) const bool DITHER = false;
layout(constant_id = 8) const uint LEVEL_SIZE = 2u;  // frame texels per bloom texel along a side: 2 or 4
layout(constant_id = 9) const uint TRANSFER_TERMS = 8u;
layout(constant_id = 10) const bool WIDE = false;  // some scene components are negative
// The unquantised image is made beside another one, which counts.
const bool COUNT = WIDE && OUTPUT != OUTPUT_FLOAT;
layout(constant_id = 11) const uint ALPHA = ALPHA_ASSOCIATED;  // if every alpha is 1, always this one
layout(constant_id = 12) const uint DISPLAY = DISPLAY_REC709;
layout(constant_id = 13) const bool UNROUNDED = false;
layout(constant_id = 14) const uint LIMIT = DISPLAY_REC709;
layout(constant_id = 15) const bool GAIN = false;  // alpha holds the code of a gain map
const bool MEASURE = OUTPUT != OUTPUT_FLOAT && DISPLAY != DISPLAY_REC709;  // PQ and HLG

layout(set = 0, binding = 1) uniform utextureBuffer bloom;
layout(set = 0, binding = 2) uniform utextureBuffer table_points;
layout(set = 0, binding = 3) uniform utextureBuffer gain_points;
layout(push_constant) uniform Push { ResolveParams p; };
#include "glsl/input.glsl"
#include "glsl/bloom_row.glsl"
#include "glsl/transfer.glsl"
#include "glsl/table.glsl"
#include "glsl/aces2_powers.glsl"
#include "glsl/aces2.glsl"
#include "glsl/curves.glsl"
#include "glsl/straight.glsl"
#include "glsl/gain.glsl"
#include "glsl/dither.glsl"

layout(buffer_reference, std430, buffer_reference_align = 4) buffer Tiles { TileRecord v; };

uint gamut_cut_components;  // of this invocation's texels
uint negative_light_bits;   // the same
uint shown_max_bits;        // the same, and the next one
uint shown_sum;

// Counts the components of curve_light() v that are cut. `counted` is 0 for a texel outside the frame. A table with
// the axes AP1 knows nothing of what is outside of AP1, so its error there is not that of a rounding.
void count_cut(vec3 x, vec3 v, uint counted) {
  vec3 size = abs(x);
  float largest = max(max(size.r, size.g), size.b);
  uvec3 cut = uvec3(lessThan(v, vec3(-GAMUT_TOLERANCE * largest)));
  gamut_cut_components += (cut.r + cut.g + cut.b) * counted;
  if (CURVE == CURVE_TABLE_AP1) {
    const float roundings = 9.5367431640625e-7;  // 2^-20
    const uint infinity = 0x7f800000u;
    bool outside = min(min(v.r, v.g), v.b) < -roundings * largest;
    negative_light_bits = max(negative_light_bits, infinity * (uint(outside) & counted));
  }
}

// Notes how far the scene's light is below 0, where terms of both signs may cancel and leave their roundings.
void note_negative(vec3 scene, uint counted) {
  float least = min(min(scene.r, scene.g), scene.b);
  uint bits = floatBitsToUint(at_least(-least, 0.0) * p.exposure);
  negative_light_bits = max(negative_light_bits, bits & (0u - counted));
}

// The display light of exposed light.
vec3 display_light(vec3 exposed) {
  vec3 v = curve_light(exposed);
  if (WIDE) v = at_least(v, 0.0);
  if (CURVE == CURVE_ACES_2) {
    vec3 light = at_most(at_least(aces2(v), 0.0), 1.0);
    return LIMIT == DISPLAY ? light : p3_in_rec2020(light);
  }
  return curve(v, p.curve_white);
}

// Notes how bright the image is.
void note_shown(vec3 light, uint counted) {
  float largest = max(max(light.r, light.g), light.b);
  shown_max_bits = max(shown_max_bits, floatBitsToUint(largest) & (0u - counted));
  shown_sum += uint(largest * SHOWN_SCALE + 0.5) * counted;
}

// The display value of exposed light.
vec3 shown(vec3 exposed) { return encode(display_light(exposed)); }

// The display value of no light; only for ALPHA_STRAIGHT.
vec3 black;

vec4 straight(vec3 exposed, float a, uint counted) {
  if (COUNT) count_cut(exposed, curve_light(exposed), counted);  // the object has the same components
  StraightLight light = straight_light(exposed, a);
  vec3 object = display_light(light.object);
  if (MEASURE) note_shown(object, counted);
  StraightPixel pixel = straight_pixel(light, encode(object), shown(light.own), black, a);
  return vec4(pixel.colour, pixel.alpha);
}

// The resized scene is read as it is.
vec4 scene_texel(vec4 wire) {
  if (PIXELS == PIXELS_SCENE) return wire;
  if (UNROUNDED) return ingest_unrounded(p.frame, wire);
  return WIDE ? ingest_wide(p.frame, wire) : ingest(p.frame, wire);
}

vec4 image_texel(vec4 wire, vec3 glow, uint counted) {
  vec4 scene = scene_texel(wire);
  if (COUNT) note_negative(scene.rgb, counted);
  vec3 x = BLOOM == BLOOM_CONSERVE ? scene.rgb * p.scene_scale : scene.rgb;
  if (BLOOM != BLOOM_NONE) x += p.bloom_scale * glow;
  float a = at_most(at_least(scene.a, 0.0), 1.0);
  if (ALPHA == ALPHA_OVER) x += (1.0 - a) * vec3(p.background_r, p.background_g, p.background_b);
  vec3 exposed = WIDE ? clamp(x * p.exposure, -MAX_EXPOSED_VALUE, MAX_EXPOSED_VALUE)
                      : at_most(at_least(x, 0.0) * p.exposure, MAX_EXPOSED_VALUE);
  if (ALPHA == ALPHA_STRAIGHT) return straight(exposed, a, counted);
  if (COUNT) count_cut(exposed, curve_light(exposed), counted);
  vec3 light = display_light(exposed);
  if (MEASURE) note_shown(light, counted);
  if (GAIN) return vec4(encode(light), gain_code(exposed));
  return vec4(encode(light), ALPHA == ALPHA_ASSOCIATED ? scene.a : 1.0);
}

// Rounds texel (x, y) to codes. RGB must be in [0, 1]; alpha is clamped here.
uvec4 quantise(vec4 c, float codes, uint x, uint y) {
  vec4 v = vec4(c.rgb, at_most(at_least(c.a, 0.0), 1.0)) * codes;
  if (DITHER) v.rgb = at_most(at_least(v.rgb + dither_noise(x, y, p.dither_frame), 0.0), codes);
  return uvec4(v + 0.5);
}

uint64_t pack16(uvec4 v) { return pack64(v.xz | (v.yw << 16)); }

uint64_t pack_texel(vec4 c, uint x, uint y) {
  if (OUTPUT == OUTPUT_RGBA16) return pack16(quantise(c, 65535.0, x, y));
  return pack_halves(c);
}

void write(uint x, uint y, Group g) {
  uint at = (y - p.first_row) * p.output_pitch + x;
  if (OUTPUT == OUTPUT_RGBA8) {
    uvec4 v;
    [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) {
      uvec4 q = quantise(g.texel[i], 255.0, x + i, y);
      v[i] = q.r | (q.g << 8) | (q.b << 16) | (q.a << 24);
    }
    written[at / 4u] = pack64(v);
  } else if (OUTPUT == OUTPUT_FLOAT) {
    [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) written[at + i] = pack64(floatBitsToUint(g.texel[i]));
  } else {
    written[at / 2u] = u64vec2(pack_texel(g.texel[0], x, y), pack_texel(g.texel[1], x + 1u, y));
    written[at / 2u + 1u] = u64vec2(pack_texel(g.texel[2], x + 2u, y), pack_texel(g.texel[3], x + 3u, y));
  }
}

// One row of a group. `near_weight` is the weight of the nearer of the two bloom rows around it.
void resolve_row(uint x, uint y, BloomRow far, BloomRow near, float near_weight) {
  WireGroup wire = load_wire(p.frame, x, y);
  Group g;
  [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) {
    g.texel[i] = image_texel(wire_texel(wire, i), (1.0 - near_weight) * far.c[i] + near_weight * near.c[i],
                             uint(x + i < p.frame.width));
  }
  write(x, y, g);
}

// The groups at x in rows first_row to rows_end - 1; at most RESOLVE_ROWS of them.
void resolve_block(uint x, uint first_row, uint rows_end) {
  BloomRow above = bloom_row(x, int(first_row / LEVEL_SIZE) - 1);
  BloomRow here = bloom_row(x, int(first_row / LEVEL_SIZE));
  [[unroll]] for (uint i = 0u; i < RESOLVE_ROWS; i += LEVEL_SIZE) {
    uint y = first_row + i;
    if (y >= rows_end) break;
    BloomRow below = bloom_row(x, int(y / LEVEL_SIZE) + 1);
    if (LEVEL_SIZE == 4u) {
      resolve_row(x, y, above, here, 0.625);
      if (y + 1u < p.frame.height) resolve_row(x, y + 1u, above, here, 0.875);
      if (y + 2u < p.frame.height) resolve_row(x, y + 2u, below, here, 0.875);
      if (y + 3u < p.frame.height) resolve_row(x, y + 3u, below, here, 0.625);
    } else {
      resolve_row(x, y, above, here, 0.75);
      if (y + 1u < p.frame.height) resolve_row(x, y + 1u, below, here, 0.75);
    }
    above = here;
    here = below;
  }
}

void main() {
  if (CURVE == CURVE_ACES_2) load_aces2();
  if (ALPHA == ALPHA_STRAIGHT) black = shown(vec3(0.0));
  uint first_row = gl_GlobalInvocationID.y * RESOLVE_ROWS;
  uint rows_end = min(first_row + RESOLVE_ROWS, p.frame.height);
  uint block = RESOLVE_GROUP_X * GROUP_TEXELS;
  uint x = gl_WorkGroupID.x * RESOLVE_STEPS * block + gl_LocalInvocationID.x * GROUP_TEXELS;
  uint x_end = min(x + RESOLVE_STEPS * block, p.frame.width);
  // A loop rather than an if(), because the software device executes the body that an if() skips.
  gamut_cut_components = 0u;
  negative_light_bits = 0u;
  shown_max_bits = 0u;
  shown_sum = 0u;
  for (; x < x_end; x += block) resolve_block(x, first_row, rows_end);
  if (COUNT) {
    uint cut = subgroupAdd(gamut_cut_components);
    uint negative = subgroupMax(negative_light_bits);
    uint largest = subgroupMax(shown_max_bits);
    uint sum = subgroupAdd(shown_sum);
    Tiles tiles = Tiles(uvec2(p.tiles_lo, p.tiles_hi));
    if (subgroupElect()) {
      atomicAdd(tiles.v.gamut_cut_components, cut);
      atomicMax(tiles.v.negative_light_bits, negative);
      if (MEASURE) {
        atomicMax(tiles.v.shown_max_bits, largest);
        atomicAdd(tiles.v.shown_sum_low, sum & ((1u << SHOWN_LOW_BITS) - 1u));
        atomicAdd(tiles.v.shown_sum_high, sum >> SHOWN_LOW_BITS);
      }
    }
  }
}
