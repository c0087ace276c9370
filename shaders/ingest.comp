// Metering, phase A of a frame: reads the frame once and adds up its luminance.
//
// In: the wire's pixels, and for WEIGHTS_CENTER the table of weights. Out: one TileRecord per tile, and with
// HISTOGRAM the histogram.
// Method: an invocation walks GROUP_TEXELS columns down INGEST_ROWS rows without a barrier, block after block
// from left to right, and adds its sums to each tile's record once. It reads neighbours in memory one after
// the other, so that processors prefetch them. All sums are of integers, so the order of execution does not
// change the result.
// A frame is first read without SCRUB and ALPHA. Only if that finds bad values or light beyond the largest half
// is it read again with SCRUB, which counts them, and only if it finds an alpha other than 1, with ALPHA, which
// finds absent texels and weighs by alpha.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "glsl/common.glsl"

layout(local_size_x = INGEST_GROUP_X, local_size_y = INGEST_GROUP_Y) in;
layout(constant_id = 0) const uint PIXELS = PIXELS_RGBA16F;
layout(constant_id = 1) const bool MATRIX = false;
layout(constant_id = 2) const bool SCRUB = false;
layout(constant_id = 3) const bool LIGHT = true;  // bloom needs max_light_bits
layout(constant_id = 4) const uint WEIGHTS = WEIGHTS_AVERAGE;
layout(constant_id = 5) const bool HISTOGRAM = false;
layout(constant_id = 6) const bool WHOLE = false;  // the width is a multiple of GROUP_TEXELS
layout(constant_id = 7) const bool IGNORE = false;  // texels darker than p.ignore_below have no weight
layout(constant_id = 8) const uint ALPHA = METER_OPAQUE;
const bool TRANSLUCENT = ALPHA != METER_OPAQUE;  // absent texels are counted and have no weight
// The sum of the weights is not just the number of texels.
const bool SUM_WEIGHTS = WEIGHTS != WEIGHTS_AVERAGE || IGNORE || TRANSLUCENT;
// The sums of weighted fixed-point values take more than 32 bits.
const bool SPLIT = WEIGHTS == WEIGHTS_CENTER || ALPHA == METER_COVERAGE || SCRUB;
const uint BINS = SCRUB ? HISTOGRAM_SCRUB_BINS : HISTOGRAM_BINS;

layout(push_constant) uniform Push { IngestParams p; };
#include "glsl/input.glsl"

layout(set = 0, binding = 1) uniform utextureBuffer center_weights;
layout(buffer_reference, std430, buffer_reference_align = 4) buffer Histogram { HistogramBin v; };
layout(buffer_reference, std430, buffer_reference_align = 4) buffer Tiles { TileRecord v; };

// (log2(max(l, MIN_METERED_LUMINANCE)) + LOG2_BIAS) in fixed point: the exponent plus a polynomial for
// log2(1 + t) of the mantissa. Vulkan requires every operation here to be correctly rounded, so every device
// gets the same bits. Errors are in EV; shaders/fit/polynomials.py computes them.
// fit: t in [0, 1], degree 6, error 1.9e-06, best 1.8e-06
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

// floor(256 d2 / (W^2 + H^2)) by long division, with d2 the squared distance to the centre in half texels. d2
// is less than the divisor, and both are below 2^30.
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
    // Unsigned: texels to the left of the spot or above it wrap round.
    return x - p.spot_x0 < p.spot_x1 - p.spot_x0 && y - p.spot_y0 < p.spot_y1 - p.spot_y0 ? 1u : 0u;
  }
  if (WEIGHTS == WEIGHTS_CENTER) {
    uint at = center_step(x, y);
    return texelFetch(center_weights, int(at / 4u))[at & 3u];
  }
  return 1u;
}

// One invocation's sums over a tile; clear() resets them.
uint log2_sum;       // weighted; with SPLIT only the sum of the low 16 bits
uint log2_sum_high;  // with SPLIT the sum of the higher bits
uint weight_sum;
// Luminance as bits, ordered as integers like in at_least(), so that a NaN in padding does no harm.
int max_luminance;
int min_luminance;
uint max_magnitude;  // as notes; see note_row()
uint max_scene_magnitude;  // of R, G and B after the matrix
uint other_alphas;   // not 0 after an alpha other than 1; only with SCRUB and without ALPHA
uint absent_texels;
uint coverage;  // as in TileRecord
uint negative_halves;  // two counts of 16 bits
uint negative_components;
uint negative_scene_components;
int max_light;
uint nan_components;
uint infinite_components;
uint clamped_components;
uint first_bad_texel;

void clear() {
  log2_sum = 0u;
  log2_sum_high = 0u;
  weight_sum = 0u;
  max_luminance = 0;
  min_luminance = 0x7fffffff;
  max_magnitude = 0u;
  max_scene_magnitude = 0u;
  other_alphas = 0u;
  absent_texels = 0u;
  coverage = 0u;
  negative_halves = 0u;
  negative_components = 0u;
  negative_scene_components = 0u;
  max_light = 0;
  nan_components = 0u;
  infinite_components = 0u;
  clamped_components = 0u;
  first_bad_texel = 0xffffffffu;
}

// The sign bits of R, G and B of wire texel i. They come from its words, because a device may drop the sign of
// a NaN when it converts it.
uvec3 signs(WireGroup g, uint i) {
  if (PIXELS == PIXELS_RGBA32F) return g.words[i].rgb >> 31;
  if (PIXELS == PIXELS_RGB9E5) return uvec3(0u);
  uvec2 halves = half_words(g, i);
  return uvec3(halves.x >> 15, halves.x >> 31, halves.y >> 15) & 1u;
}

void count_bad(WireGroup g, uint i, vec4 wire, uint counted, uint texel) {
  uvec3 negative = signs(g, i);
  vec3 scene = ingest_unclamped(p.frame, wire).rgb;
  uint bad = 0u;
  [[unroll]] for (uint c = 0u; c < 3u; ++c) {
    uint nan = uint(is_nan(wire[c]));
    uint infinite = uint(is_infinite(wire[c]));
    uint clamped = uint(abs(wire[c]) > MAX_LIGHT) & ~infinite;
    if (MATRIX) clamped += uint(abs(scene[c]) > MAX_LIGHT);
    negative_components -= nan & negative[c] & counted;
    nan_components += nan & counted;
    infinite_components += infinite & counted;
    clamped_components += clamped & counted;
    bad |= nan | infinite | clamped;
  }
  if ((bad & counted) != 0u) first_bad_texel = min(first_bad_texel, texel);
}

// The weight of a texel that alpha covers in part. Without WEIGHTS_CENTER a weight of 1 stands as 255.
uint covered_weight(uint weight, float alpha) {
  precise float scaled = at_most(at_least(alpha, 0.0), 1.0) * 255.0 + 0.5;
  uint code = uint(scaled);
  coverage |= uint(code != 0u) | (uint(code - 1u < 254u) << 1);
  if (WEIGHTS != WEIGHTS_CENTER) return code * weight;
  uint product = code * weight + 127u;
  return (product + 1u + (product >> 8)) >> 8;  // product / 255, for products below 65535
}

uint weighted_offset(uint offset, uint weight) {
  if (WEIGHTS == WEIGHTS_CENTER) return (offset * weight + 128u) >> 8;
  return ALPHA == METER_COVERAGE ? (offset * weight + 127u) / 255u : offset;
}

// Adds one texel's metered value. `copies` is the copy of the histogram that this tile uses.
void add_to_meter(uint fixed_point, uint weight, Histogram copies) {
  if (SPLIT) {
    log2_sum += (fixed_point & 0xffffu) * weight;
    log2_sum_high += (fixed_point >> 16) * weight;
  } else {
    log2_sum += fixed_point * weight;
  }
  if (SUM_WEIGHTS) weight_sum += weight;
  if (HISTOGRAM && weight != 0u) {
    uint bin = min(fixed_point >> HISTOGRAM_SHIFT, BINS - 1u);
    uint offset = fixed_point - (bin << HISTOGRAM_SHIFT);
    atomicAdd(copies[bin].v.weight, weight);
    atomicAdd(copies[bin].v.offset_sum, weighted_offset(offset, weight));
  }
}

const uint ALPHA_MASK = TRANSLUCENT ? 0x7fff7fffu : 0xffff7fffu;
const uint ALPHA_ADDEND = TRANSLUCENT ? 0x04000400u : 0xc4000400u;

// What a row of a group shows of its components' magnitudes and of its alphas. For halves both are sums of two
// components each, of which some bits count.
struct Notes {
  uint first;   // halves: R and G; floats: the largest magnitude
  uint second;  // halves: B and alpha; floats: not 0 after an alpha other than 1
};

// Records whether a component of the wire texel is beyond MAX_HALF, whether alpha is 1 and how many of
// R, G and B are negative. `counted` is all ones, or 0 for a texel outside the frame.
void note_halves(uvec2 words, uint counted, inout Notes notes) {
  uvec2 magnitudes = words & uvec2(0x7fff7fffu, ALPHA_MASK);
  // Bit 15 or 31 of the first sum is set if the exponent is all ones, and of the second if the magnitude is
  // not 0. Without ALPHA the same addition takes 1 from alpha.
  uvec2 beyond = magnitudes + uvec2(0x04000400u, ALPHA_ADDEND);
  notes.first |= beyond.x & counted;
  notes.second |= beyond.y & counted;
  uvec2 negative = (magnitudes + 0x7fff7fffu) & words & uvec2(0x80008000u, 0x00008000u);
  negative_halves += ((negative.x >> 15) + (negative.y >> 15)) & counted;
}

void note_floats(uvec4 words, uint counted, inout Notes notes) {
  uvec4 magnitudes = words & 0x7fffffffu;
  uint largest = max(max(magnitudes.r, magnitudes.g), magnitudes.b);
  if (TRANSLUCENT) {
    largest = max(largest, magnitudes.a);
  } else {
    notes.second |= (words.a ^ floatBitsToUint(1.0)) & counted;
  }
  notes.first = max(notes.first, largest & counted);
  uvec3 negative = ((magnitudes.rgb + 0x7fffffffu) & words.rgb) >> 31;
  negative_components += (negative.r + negative.g + negative.b) & counted;
}

// This also counts a NaN with its sign bit set as negative; count_bad() takes that back.
void note(WireGroup wire, uint i, uint counted, inout Notes notes) {
  if (PIXELS == PIXELS_RGBA16F) note_halves(half_words(wire, i), counted, notes);
  if (PIXELS == PIXELS_RGBA32F) note_floats(wire.words[i], counted, notes);
}

// Without TRANSLUCENT, and for halves without SCRUB, the frame's magnitudes and alphas share max_magnitude, so that
// a frame without alpha pays for no other register. All in all, looking at alpha costs 2.5 % of the pass's
// instructions. For halves, bits 16 to 30 are those of alphas other than 1 and -1, and bits 15 and 31 say that
// a component is too large; if there are such alphas or -1, bit 31 may say so falsely, and a second read finds
// out. For floats, bit 31 stands for an alpha other than 1.
void note_row(Notes notes) {
  const uint beyond = 0x80008000u;
  if (PIXELS == PIXELS_RGBA16F) {
    if (SCRUB && !TRANSLUCENT) {
      max_magnitude |= (notes.first & beyond) | (notes.second & 0x8000u);
      other_alphas |= notes.second >> 16;
    } else {
      max_magnitude |= (notes.first & beyond) | notes.second;
    }
  } else if (PIXELS == PIXELS_RGBA32F) {
    max_magnitude = (max_magnitude & 0x80000000u) | max(max_magnitude & 0x7fffffffu, notes.first);
    if (!TRANSLUCENT) max_magnitude |= notes.second != 0u ? 0x80000000u : 0u;
  }
}

// All ones for a texel without light whose alpha is 0 or less, after the scrub; else 0.
uint absent(vec4 wire) {
  uvec4 bits = floatBitsToUint(SCRUB ? scrub(wire) : wire);
  bool dark = ((bits.r | bits.g | bits.b) << 1) == 0u;
  return dark && int(bits.a) <= 0 ? 0xffffffffu : 0u;
}

// Counts and meters one row of a group. `counted` is all ones for each texel inside the frame, and 0 for the
// others.
void meter_row(uint x, uint y, uvec4 counted, Histogram copies) {
  WireGroup words = load_wire(p.frame, x, y);
  Notes notes = Notes(0u, 0u);
  [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) {
    vec4 wire = wire_texel(words, i);
    note(words, i, counted[i], notes);
    if (SCRUB) count_bad(words, i, wire, counted[i], y * p.frame.width + x + i);

    vec4 texel = ingest(p.frame, wire);
    vec3 scene = texel.rgb;
    if (MATRIX) {
      uvec3 magnitudes = floatBitsToUint(ingest_unrounded(p.frame, wire).rgb) & 0x7fffffffu;
      max_scene_magnitude = max(max_scene_magnitude, max(max(magnitudes.r, magnitudes.g), magnitudes.b) & counted[i]);
      uvec3 negative = uvec3(lessThan(scene, vec3(0.0)));
      negative_scene_components += (negative.r + negative.g + negative.b) & counted[i];
    }
    float l = luminance(scene);
    // As integers, like in at_least(). A negative luminance is below every limit.
    uint metered = IGNORE && floatBitsToInt(l) < floatBitsToInt(p.ignore_below) ? 0u : counted[i];
    if (TRANSLUCENT) {
      uint missing = absent(wire);
      metered &= ~missing;
      absent_texels += missing & counted[i] & 1u;
    }
    if (WEIGHTS == WEIGHTS_AVERAGE && !HISTOGRAM && !SPLIT) {
      log2_sum += fixed_log2(l) & metered;
      if (SUM_WEIGHTS) weight_sum += metered & 1u;
    } else {
      uint weight = weight_of(x + i, y);
      if (ALPHA == METER_COVERAGE) weight = covered_weight(weight, counted[i] != 0u ? texel.a : 0.0);
      add_to_meter(fixed_log2(l), weight & metered, copies);
    }
    int order = floatBitsToInt(l) & int(counted[i]);
    max_luminance = max(max_luminance, order);
    min_luminance = min(min_luminance, order | int(~counted[i] & 0x7fffffffu));
    if (LIGHT) max_light = max(max_light, floatBitsToInt(luminance(at_least(scene, 0.0))) & int(counted[i]));
  }
  note_row(notes);
}

// Meters a group's columns over INGEST_ROWS rows.
void walk_down(uint x, uint first_row, Histogram copies) {
  uvec4 inside = uvec4(0xffffffffu);
  if (!WHOLE) inside *= uvec4(lessThan(uvec4(x, x + 1u, x + 2u, x + 3u), uvec4(p.frame.width)));
  uint rows_end = min(first_row + INGEST_ROWS, p.frame.height);
  for (uint y = first_row; y < rows_end; ++y) meter_row(x, y, inside, copies);
}

// Adds the work group's sums over a tile to the tile's record.
void add_to_tile(uint tile) {
  // Nothing overflows; docs/pipeline.md section 2 has the proof.
  Tiles tiles = Tiles(uvec2(p.tiles_lo, p.tiles_hi));
  uint low = subgroupAdd(log2_sum & 0xffffu);
  uint high = subgroupAdd((log2_sum >> 16) + log2_sum_high);
  uint weight = SUM_WEIGHTS ? subgroupAdd(weight_sum) : 0u;
  uint brightest = uint(subgroupMax(max_luminance));
  uint darkest = ~uint(max(subgroupMin(min_luminance), 0));
  if (PIXELS == PIXELS_RGBA16F) {
    if (!SCRUB && !TRANSLUCENT) other_alphas = max_magnitude & 0x7fff0000u;
    max_magnitude = (max_magnitude & 0x80008000u) != 0u ? 0x7f800000u : 0u;
    negative_components += (negative_halves & 0xffffu) + (negative_halves >> 16);
  }
  if (PIXELS == PIXELS_RGBA32F && !TRANSLUCENT) {
    other_alphas = max_magnitude >> 31;
    max_magnitude &= 0x7fffffffu;
  }
  uint magnitude = subgroupMax(MATRIX ? max(max_magnitude, max_scene_magnitude) : max_magnitude);
  uint negative = subgroupAdd(negative_components);
  uint negative_scene = MATRIX ? subgroupAdd(negative_scene_components) : 0u;
  uint light = LIGHT ? uint(subgroupMax(max_light)) : 0u;
  uint alphas = TRANSLUCENT ? subgroupAdd(absent_texels) : subgroupOr(other_alphas);
  uint covered = ALPHA == METER_COVERAGE ? subgroupOr(coverage) : 0u;
  if (subgroupElect()) {
    atomicAdd(tiles[tile].v.log2_sum_low, low);
    atomicAdd(tiles[tile].v.log2_sum_high, high);
    atomicMax(tiles[tile].v.max_luminance_bits, brightest);
    atomicMax(tiles[tile].v.min_luminance_bits_inverted, darkest);
    atomicMax(tiles[tile].v.max_magnitude_bits, magnitude);
    if (negative != 0u) atomicAdd(tiles[tile].v.negative_components, negative);
    if (negative_scene != 0u) atomicAdd(tiles[tile].v.negative_scene_components, negative_scene);
    if (LIGHT) atomicMax(tiles[tile].v.max_light_bits, light);
    if (TRANSLUCENT) atomicAdd(tiles[tile].v.absent_texels, alphas);
    if (ALPHA == METER_COVERAGE) atomicOr(tiles[tile].v.coverage, covered);
    if (!TRANSLUCENT && alphas != 0u) atomicOr(tiles[tile].v.alpha_differs, alphas);
    if (SUM_WEIGHTS) atomicAdd(tiles[tile].v.weight_sum, weight);
  }
  if (SCRUB) {
    atomicAdd(tiles[tile].v.nan_components, nan_components);
    atomicAdd(tiles[tile].v.infinite_components, infinite_components);
    atomicAdd(tiles[tile].v.clamped_components, clamped_components);
    atomicMax(tiles[tile].v.first_bad_texel_inverted, ~first_bad_texel);
  }
}

void main() {
  uint first_row = gl_GlobalInvocationID.y * INGEST_ROWS;
  uint tiles_end = min((gl_WorkGroupID.x + 1u) * INGEST_TILES, p.tiles_x);
  for (uint tile_x = gl_WorkGroupID.x * INGEST_TILES; tile_x < tiles_end; ++tile_x) {
    uint tile = gl_WorkGroupID.y * p.tiles_x + tile_x;
    Histogram copies = Histogram(uvec2(p.histogram_lo, p.histogram_hi));
    if (HISTOGRAM) copies = copies[tile / HISTOGRAM_TILES * BINS];
    clear();
    uint x = tile_x * TILE_TEXELS + gl_LocalInvocationID.x * GROUP_TEXELS;
    uint x_end = min((tile_x + 1u) * TILE_TEXELS, p.frame.width);
    for (; x < x_end; x += INGEST_GROUP_X * GROUP_TEXELS) walk_down(x, first_row, copies);
    add_to_tile(tile);
  }
}
