// Declarations and functions that all passes share.
//
// Three choices are for the software device. Textures are read through texel buffers, which it gathers well.
// They are written through a storage buffer, 8 bytes at a time, because it stores lane after lane and word
// after word; stores by address take twice as long. Loops that keep rows for the next iteration are unrolled,
// because it would keep the rows in memory otherwise.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference2 : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require

#include "params.h"

// The output of a pass, or as many of its rows as a storage buffer can hold on every device. The parameters
// give the first of these rows.
layout(set = 0, binding = 4, std430) writeonly buffer Written { u64vec2 written[]; };

u64vec2 pack64(uvec4 words) { return u64vec2(pack64(words.xy), pack64(words.zw)); }

// A texel of a bloom level.
vec3 fetch_rgb(utextureBuffer level, int index) { return uintBitsToFloat(texelFetch(level, index).rgb); }
u64vec2 level_words(vec3 texel) { return pack64(floatBitsToUint(vec4(texel, 0.0))); }

// Rec.709 luminance, added in the order that docs/pipeline.md section 2 fixes, so that every device gets the
// same bits.
float luminance(vec3 c) {
  precise float l = (0.2126 * c.r + 0.7152 * c.g) + 0.0722 * c.b;
  return l;
}

// max(x, low) and min(x, high) for bounds >= 0, compared as integers. The bits of non-negative floats have
// the same order as integers, and negative floats come below all of them. This is one instruction; a driver's
// float min or max takes three because it handles NaN.
float at_least(float x, float low) { return intBitsToFloat(max(floatBitsToInt(x), floatBitsToInt(low))); }
float at_most(float x, float high) { return intBitsToFloat(min(floatBitsToInt(x), floatBitsToInt(high))); }
vec3 at_least(vec3 x, float low) { return intBitsToFloat(max(floatBitsToInt(x), floatBitsToInt(low))); }
vec3 at_most(vec3 x, float high) { return intBitsToFloat(min(floatBitsToInt(x), floatBitsToInt(high))); }

// Rounds a float to the nearest half, ties to even. The result is a float. Right only for |x| <= 65504.
float round_to_half(float x) {
  uint bits = floatBitsToUint(x);
  uint magnitude = bits & 0x7fffffffu;
  uint rounded;
  if (magnitude < 0x38800000u) {  // halves below 2^-14 are multiples of 2^-24, the step of floats in [0.5, 1)
    precise float shifted = uintBitsToFloat(magnitude) + 0.5;
    precise float back = shifted - 0.5;
    rounded = floatBitsToUint(back);
  } else {
    rounded = (magnitude + 0x0fffu + ((magnitude >> 13) & 1u)) & 0xffffe000u;
  }
  return uintBitsToFloat(rounded | (bits & 0x80000000u));
}

vec4 round_to_half(vec4 c) {
  return vec4(round_to_half(c.r), round_to_half(c.g), round_to_half(c.b), round_to_half(c.a));
}

// The bits of the half nearest to x, ties to even. |x| <= 65504. packHalf2x16 may round otherwise, and the
// software device takes several times as many instructions for it.
uint half_bits(float x) {
  uint bits = floatBitsToUint(x);
  uint magnitude = bits & 0x7fffffffu;
  // A half's exponent has a bias that is 112 less.
  uint normal = (magnitude + 0xc8000fffu + ((magnitude >> 13) & 1u)) >> 13;
  precise float shifted = uintBitsToFloat(magnitude) + 0.5;  // as in round_to_half
  uint small = floatBitsToUint(shifted) - 0x3f000000u;
  return (int(magnitude) < 0x38800000 ? small : normal) | ((bits >> 16) & 0x8000u);
}

// RGBA halves. Alpha 1 costs nothing.
uint64_t pack_halves(vec3 c) {
  return pack64(uvec2(half_bits(c.r) | (half_bits(c.g) << 16), half_bits(c.b) | 0x3c000000u));
}
uint64_t pack_halves(vec4 c) {
  return pack64(uvec2(half_bits(c.r) | (half_bits(c.g) << 16), half_bits(c.b) | (half_bits(c.a) << 16)));
}

bool is_nan(float x) { return (floatBitsToUint(x) & 0x7fffffffu) > 0x7f800000u; }
bool is_infinite(float x) { return (floatBitsToUint(x) & 0x7fffffffu) == 0x7f800000u; }

float scrub_alpha(float x) { return is_nan(x) ? 0.0 : clamp(x, -MAX_HALF, MAX_HALF); }
float scrub_light(float x) { return is_infinite(x) ? scrub_alpha(x) : is_nan(x) ? 0.0 : clamp(x, -MAX_LIGHT, MAX_LIGHT); }
vec4 scrub(vec4 c) { return vec4(scrub_light(c.r), scrub_light(c.g), scrub_light(c.b), scrub_alpha(c.a)); }
