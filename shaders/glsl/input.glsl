// Ingest: the wire's pixels to scene pixels (docs/pipeline.md section 1). The scene is not stored. Each pass
// that reads the frame ingests it texel by texel, with arithmetic that gives the same bits every time.
//
// The including shader declares the constants PIXELS, MATRIX and SCRUB. Without SCRUB a texel is right only if
// its components are finite and within +-65504, on the wire and in the scene. Frames are all of one kind:
// ingest finds out which.

// The frame's bytes, four words per element whatever the pixel format.
layout(set = 0, binding = 0) uniform utextureBuffer wire_words;

struct Group {
  vec4 texel[GROUP_TEXELS];
};

vec4 unpack_half4(uvec2 words) { return vec4(unpackHalf2x16(words.x), unpackHalf2x16(words.y)); }

// E5B9G9R9: 9-bit mantissas without a hidden bit and an exponent with bias 15. Exact in float.
vec4 unpack_rgb9e5(uint word) {
  float scale = uintBitsToFloat(((word >> 27) + 103u) << 23);  // 2^(e - 15 - 9)
  return vec4(vec3(word & 0x1ffu, (word >> 9) & 0x1ffu, (word >> 18) & 0x1ffu) * scale, 1.0);
}

// The words of GROUP_TEXELS wire texels of row y, from texel x on, which is a multiple of GROUP_TEXELS. How
// many elements are used depends on the format. Texels beyond the width are padding with arbitrary values.
struct WireGroup {
  uvec4 words[GROUP_TEXELS];
};

WireGroup load_wire(InputParams frame, uint x, uint y) {
  uint at = y * frame.input_pitch + x;
  WireGroup g;
  if (PIXELS == PIXELS_RGBA16F) {
    g.words[0] = texelFetch(wire_words, int(at / 2u));
    g.words[1] = texelFetch(wire_words, int(at / 2u + 1u));
  } else if (PIXELS == PIXELS_RGBA32F || PIXELS == PIXELS_SCENE) {
    [[unroll]] for (uint i = 0u; i < GROUP_TEXELS; ++i) g.words[i] = texelFetch(wire_words, int(at + i));
  } else {
    g.words[0] = texelFetch(wire_words, int(at / 4u));
  }
  return g;
}

// The two words of texel i. For PIXELS_RGBA16F.
uvec2 half_words(WireGroup g, uint i) { return (i & 1u) == 0u ? g.words[i / 2u].xy : g.words[i / 2u].zw; }

vec4 wire_texel(WireGroup g, uint i) {
  if (PIXELS == PIXELS_RGBA16F) return unpack_half4(half_words(g, i));
  if (PIXELS == PIXELS_RGBA32F || PIXELS == PIXELS_SCENE) return uintBitsToFloat(g.words[i]);
  return unpack_rgb9e5(g.words[0][i]);
}

// A scene texel from a wire texel before it is clamped and rounded: scrub, primaries.
vec4 ingest_unclamped(InputParams frame, vec4 wire) {
  vec4 c = SCRUB ? scrub(wire) : wire;
  if (!MATRIX) return c;
  precise float r = (frame.m00 * c.r + frame.m01 * c.g) + frame.m02 * c.b;
  precise float g = (frame.m10 * c.r + frame.m11 * c.g) + frame.m12 * c.b;
  precise float b = (frame.m20 * c.r + frame.m21 * c.g) + frame.m22 * c.b;
  return vec4(r, g, b, c.a);
}

// The same before it is rounded.
vec4 ingest_unrounded(InputParams frame, vec4 wire) {
  vec4 c = ingest_unclamped(frame, wire);
  return SCRUB && MATRIX ? clamp(c, -MAX_LIGHT, MAX_LIGHT) : c;
}

// Rounds components to half. Those beyond the largest half stay as they are.
vec4 rounded(vec4 c) {
  vec4 halves = round_to_half(c);
  return SCRUB ? mix(halves, c, greaterThan(abs(c), vec4(MAX_HALF))) : halves;
}

// Whether the scene's texels are rounded to half.
const bool ROUNDS = PIXELS == PIXELS_RGBA32F || MATRIX;

// A scene texel for a curve that cuts: a colour with a negative component is not rounded.
vec4 ingest_wide(InputParams frame, vec4 wire) {
  vec4 c = ingest_unrounded(frame, wire);
  bool negative = min(min(c.r, c.g), c.b) < NEGATIVE_BELOW;
  return ROUNDS && !negative ? rounded(c) : c;
}

// A scene texel from a wire texel.
vec4 ingest(InputParams frame, vec4 wire) {
  vec4 c = ingest_unrounded(frame, wire);
  return ROUNDS ? rounded(c) : c;
}
