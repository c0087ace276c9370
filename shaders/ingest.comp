// Phase A: reads the frame once, and meters it.
//
// In: the wire's pixels, and the weights of WEIGHTS_CENTER. Out: one TileRecord a tile, and the histogram (where
// HISTOGRAM).
// Method: an invocation walks GROUP_TEXELS columns down INGEST_ROWS rows with no barrier, again and again from left to
// right, and adds its sums to each tile's record once: neighbours in memory come one after the other, which is what
// processors fetch ahead. Every sum is of integers, so no order of execution shows.
// log2 is the minimax polynomial of degree 6 on the mantissa, made of operations that are correctly rounded
// everywhere (1.9e-6 EV from the truth).
// A frame is first read without SCRUB; only one that turns out to need it is read again with it, and counted.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "glsl/common.glsl"

layout(local_size_x = INGEST_GROUP_X, local_size_y = INGEST_GROUP_Y) in;
layout(constant_id = 0) const uint PIXELS = PIXELS_RGBA16F;
layout(constant_id = 1) const bool MATRIX = false;
layout(constant_id = 2) const bool SCRUB = false;
layout(constant_id = 3) const bool LIGHT = true;  // bloom asks for max_light_bits
layout(constant_id = 4) const uint WEIGHTS = WEIGHTS_AVERAGE;
layout(constant_id = 5) const bool HISTOGRAM = false;
layout(constant_id = 6) const bool WHOLE = false;  // the frame is whole groups of texels wide

layout(push_constant) uniform Push { IngestParams p; };
#include "glsl/input.glsl"

layout(set = 0, binding = 1) uniform utextureBuffer center_weights;
layout(buffer_reference, std430, buffer_reference_align = 4) buffer Histogram { HistogramBin v; };
layout(buffer_reference, std430, buffer_reference_align = 4) buffer Tiles { TileRecord v; };

// (log2(max(l, MIN_METERED_LUMINANCE)) + LOG2_BIAS) in fixed point.
uint fixed_log2(float l) {
  uint bits = floatBitsToUint(at_least(l, MIN_METERED_LUMINANCE));
  precise float t = uintBitsToFloat((bits & 0x007fffffu) | 0x3f800000u) - 1.0;
  precise float q = -0.025691079 * t + 0.121002205;
  q = q * t + -0.276540697;
  q = q * t + 0.45652163;
  q = q * t + -0.71779108;
  q = q * t + 1.44249535;
  q = q * t + 1.8456825e-06;
  precise float scaled = q * float(1u << LOG2_FRACTION_BITS) + 0.5;
  return (((bits >> 23) + LOG2_BIAS - 127u) << LOG2_FRACTION_BITS) + uint(scaled);
}

// floor(256 d2 / (W^2 + H^2)) by long division: d2, the squared distance to the centre in half texels, is the smaller
// number, and both are below 2^30.
uint center_step(uint x, uint y) {
  ivec2 d = ivec2(2u * uvec2(x, y) + 1u) - ivec2(p.frame.width, p.frame.height);
  uint rest = uint(d.x * d.x + d.y * d.y);
  uint whole = p.frame.width * p.frame.width + p.frame.height * p.frame.height;
  uint quotient = 0u;
  [[unroll]] for (uint i = 0u; i < CENTER_STEPS_LOG2; ++i) {
    rest *= 2u;
    uint fits = uint(int(whole - rest - 1u) >> 31) & 1u;  // rest >= whole
    rest -= whole * fits;
    quotient = 2u * quotient + fits;
  }
  return quotient;
}

uint weight_of(uint x, uint y) {
  if (WEIGHTS == WEIGHTS_SPOT) {
    // Unsigned: what is left of or above the spot wraps round.
    return x - p.spot_x0 < p.spot_x1 - p.spot_x0 && y - p.spot_y0 < p.spot_y1 - p.spot_y0 ? 1u : 0u;
  }
  if (WEIGHTS == WEIGHTS_CENTER) {
    uint at = center_step(x, y);
    return texelFetch(center_weights, int(at / 4u))[at & 3u];
  }
  return 1u;
}

// What one invocation has seen of a tile; see clear().
uint log2_sum;       // weighted; of WEIGHTS_CENTER only what the low 16 bits add
uint log2_sum_high;  // of WEIGHTS_CENTER: what the others add
uint weight_sum;
// Luminance as bits, in the order of at_least(): NaN in padding does no harm.
int max_luminance;
int min_luminance;
uint max_magnitude;
uint negative_halves;  // two counts, of 16 bits each
uint negative_components;
int max_light;
uint nan_components;
uint infinite_components;
uint first_bad_texel;

void clear() {
  log2_sum = 0u;
  log2_sum_high = 0u;
  weight_sum = 0u;
  max_luminance = 0;
  min_luminance = 0x7fffffff;
  max_magnitude = 0u;
  negative_halves = 0u;
  negative_components = 0u;
  max_light = 0;
  nan_components = 0u;
  infinite_components = 0u;
  first_bad_texel = 0xffffffffu;
}

void count_bad(vec4 wire, uint counted, uint texel) {
  [[unroll]] for (uint i = 0u; i < 3u; ++i) {
    negative_components -= uint(is_nan(wire[i])) & (floatBitsToUint(wire[i]) >> 31) & counted;
    nan_components += uint(is_nan(wire[i])) & counted;
    infinite_components += uint(is_infinite(wire[i])) & counted;
  }
  bool bad = is_nan(wire.r + wire.g + wire.b) || is_infinite(wire.r) || is_infinite(wire.g) || is_infinite(wire.b);
  if (bad && counted != 0u) first_bad_texel = min(first_bad_texel, texel);
}

// Adds one texel's metered value; `copies` is the tile's copy of the histogram.
void add_to_meter(uint fixed_point, uint weight, Histogram copies) {
  if (WEIGHTS == WEIGHTS_CENTER) {
    log2_sum += (fixed_point & 0xffffu) * weight;
    log2_sum_high += (fixed_point >> 16) * weight;
  } else {
    log2_sum += fixed_point * weight;
  }
  if (WEIGHTS != WEIGHTS_AVERAGE) weight_sum += weight;
  if (HISTOGRAM && weight != 0u) {
    uint bin = min(fixed_point >> HISTOGRAM_SHIFT, HISTOGRAM_BINS - 1u);
    uint offset = fixed_point - (bin << HISTOGRAM_SHIFT);
    atomicAdd(copies[bin].v.weight, weight);
    atomicAdd(copies[bin].v.offset_sum, WEIGHTS == WEIGHTS_CENTER ? (offset * weight + 128u) >> 8 : offset);
  }
}

// Notes what has to be known of a texel as it came: whether anything in it is beyond MAX_SCENE_VALUE, and how many of
// R, G and B are below 0. `counted` is all ones or none.
void note_halves(uvec2 words, uint counted) {
  uvec2 magnitudes = words & 0x7fff7fffu;
  // A sum's bit 15 or 31: an exponent of all ones; below, a magnitude that is not 0.
  uvec2 beyond = magnitudes + 0x04000400u;
  max_magnitude |= (beyond.x | beyond.y) & counted;
  uvec2 negative = (magnitudes + 0x7fff7fffu) & words & uvec2(0x80008000u, 0x00008000u);
  negative_halves += ((negative.x >> 15) + (negative.y >> 15)) & counted;
}

void note_floats(uvec4 words, uint counted) {
  uvec4 magnitudes = words & 0x7fffffffu;
  max_magnitude = max(max_magnitude, max(max(magnitudes.r, magnitudes.g), max(magnitudes.b, magnitudes.a)) & counted);
  uvec3 negative = ((magnitudes.rgb + 0x7fffffffu) & words.rgb) >> 31;
  negative_components += (negative.r + negative.g + negative.b) & counted;
}

// A NaN's sign, which is noted before, is taken back in count_bad().
void note(WireGroup wire, uint i, uint counted) {
  if (PIXELS == PIXELS_RGBA16F) note_halves(half_words(wire, i), counted);
  if (PIXELS == PIXELS_RGBA32F) note_floats(wire.words[i], counted);
}

// One row of a group: counts and meters the texels whose bit is set in `counted` (all ones or none).
void meter_row(uint x, uint y, uvec4 counted, Histogram copies) {
  WireGroup words = load_wire(p.frame, x, y);
  [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) {
    vec4 wire = wire_texel(words, i);
    note(words, i, counted[i]);
    if (SCRUB) count_bad(wire, counted[i], y * p.frame.width + x + i);

    vec3 scene = ingest(p.frame, wire).rgb;
    float l = luminance(scene);
    if (WEIGHTS == WEIGHTS_AVERAGE && !HISTOGRAM) {
      log2_sum += fixed_log2(l) & counted[i];
    } else {
      add_to_meter(fixed_log2(l), weight_of(x + i, y) & counted[i], copies);
    }
    int order = floatBitsToInt(l) & int(counted[i]);
    max_luminance = max(max_luminance, order);
    min_luminance = min(min_luminance, order | int(~counted[i] & 0x7fffffffu));
    if (LIGHT) max_light = max(max_light, floatBitsToInt(luminance(at_least(scene, 0.0))) & int(counted[i]));
  }
}

// Meters a group's columns down INGEST_ROWS rows.
void walk_down(uint x, uint first_row, Histogram copies) {
  uvec4 inside = uvec4(0xffffffffu);
  if (!WHOLE) inside *= uvec4(lessThan(uvec4(x, x + 1u, x + 2u, x + 3u), uvec4(p.frame.width)));
  uint rows_end = min(first_row + INGEST_ROWS, p.frame.height);
  for (uint y = first_row; y < rows_end; ++y) meter_row(x, y, inside, copies);
}

// Adds what was seen of a tile to its record, over the work group's invocations.
void add_to_tile(uint tile) {
  // An invocation's sum is below 2^25 * 128 texels = 2^32, or with weights up to 255 below 2^31 and 2^24. A tile's 32
  // invocations stay below 2^21 in the low half and 2^30 in the high one. The host adds the tiles up in 64 bits: 2^28
  // texels of 25 bits with 8 of weight.
  Tiles tiles = Tiles(uvec2(p.tiles_lo, p.tiles_hi));
  uint low = subgroupAdd(log2_sum & 0xffffu);
  uint high = subgroupAdd((log2_sum >> 16) + log2_sum_high);
  uint weight = WEIGHTS == WEIGHTS_AVERAGE ? 0u : subgroupAdd(weight_sum);
  uint brightest = uint(subgroupMax(max_luminance));
  uint darkest = ~uint(max(subgroupMin(min_luminance), 0));
  if (PIXELS == PIXELS_RGBA16F) {
    max_magnitude = (max_magnitude & 0x80008000u) != 0u ? 0x7f800000u : 0u;
    negative_components += (negative_halves & 0xffffu) + (negative_halves >> 16);
  }
  uint magnitude = subgroupMax(max_magnitude);
  uint negative = subgroupAdd(negative_components);
  uint light = LIGHT ? uint(subgroupMax(max_light)) : 0u;
  if (subgroupElect()) {
    atomicAdd(tiles[tile].v.log2_sum_low, low);
    atomicAdd(tiles[tile].v.log2_sum_high, high);
    atomicMax(tiles[tile].v.max_luminance_bits, brightest);
    atomicMax(tiles[tile].v.min_luminance_bits_inverted, darkest);
    atomicMax(tiles[tile].v.max_magnitude_bits, magnitude);
    if (negative != 0u) atomicAdd(tiles[tile].v.negative_components, negative);
    if (LIGHT) atomicMax(tiles[tile].v.max_light_bits, light);
    if (WEIGHTS != WEIGHTS_AVERAGE) atomicAdd(tiles[tile].v.weight_sum, weight);
  }
  if (SCRUB) {
    atomicAdd(tiles[tile].v.nan_components, nan_components);
    atomicAdd(tiles[tile].v.infinite_components, infinite_components);
    atomicMax(tiles[tile].v.first_bad_texel_inverted, ~first_bad_texel);
  }
}

void main() {
  uint first_row = gl_GlobalInvocationID.y * INGEST_ROWS;
  uint tiles_end = min((gl_WorkGroupID.x + 1u) * INGEST_TILES, p.tiles_x);
  for (uint tile_x = gl_WorkGroupID.x * INGEST_TILES; tile_x < tiles_end; ++tile_x) {
    uint tile = gl_WorkGroupID.y * p.tiles_x + tile_x;
    Histogram copies = Histogram(uvec2(p.histogram_lo, p.histogram_hi));
    if (HISTOGRAM) copies = copies[tile / HISTOGRAM_TILES * HISTOGRAM_BINS];
    clear();
    uint x = tile_x * TILE_TEXELS + gl_LocalInvocationID.x * GROUP_TEXELS;
    uint x_end = min((tile_x + 1u) * TILE_TEXELS, p.frame.width);
    for (; x < x_end; x += INGEST_GROUP_X * GROUP_TEXELS) walk_down(x, first_row, copies);
    add_to_tile(tile);
  }
}
