// The ACES 2.0 output transform (docs/pipeline.md section 5) for each pixel. Lightness j and colourfulness m are
// in units of the display's largest lightness, and achromatic responses in units of that of the white or, of
// the scene, of 100 nit. The hue stays. Source: Academy S-2024.
//
// The including shader declares table_points, which Aces2::elements() makes: constants, then the tone scale,
// then what depends on the hue. It includes log2.glsl and aces2_powers.glsl. This file is C++,
// too: server/render/host/lanes-inl.h says what that asks for.

vec3 aces2_to_cone_r, aces2_to_cone_g, aces2_to_cone_b;
vec3 aces2_to_aab_r, aces2_to_aab_g, aces2_to_aab_b;
vec3 aces2_from_aab_r, aces2_from_aab_g, aces2_from_aab_b;
vec3 aces2_to_rgb_r, aces2_to_rgb_g, aces2_to_rgb_b;
float aces2_most_light;  // of AP1
float aces2_white;       // the white's response over that of 100 nit
float aces2_saturation, aces2_threshold, aces2_strength, aces2_chroma;
float aces2_middle, aces2_focus, aces2_bottom, aces2_least_gap;

// Reads the constants, once for many pixels.
void load_aces2() {
  aces2_to_cone_r = uintBitsToFloat(texelFetch(table_points, 0).rgb);
  aces2_to_cone_g = uintBitsToFloat(texelFetch(table_points, 1).rgb);
  aces2_to_cone_b = uintBitsToFloat(texelFetch(table_points, 2).rgb);
  aces2_to_aab_r = uintBitsToFloat(texelFetch(table_points, 3).rgb);
  aces2_to_aab_g = uintBitsToFloat(texelFetch(table_points, 4).rgb);
  aces2_to_aab_b = uintBitsToFloat(texelFetch(table_points, 5).rgb);
  aces2_from_aab_r = uintBitsToFloat(texelFetch(table_points, 6).rgb);
  aces2_from_aab_g = uintBitsToFloat(texelFetch(table_points, 7).rgb);
  aces2_from_aab_b = uintBitsToFloat(texelFetch(table_points, 8).rgb);
  aces2_to_rgb_r = uintBitsToFloat(texelFetch(table_points, 9).rgb);
  aces2_to_rgb_g = uintBitsToFloat(texelFetch(table_points, 10).rgb);
  aces2_to_rgb_b = uintBitsToFloat(texelFetch(table_points, 11).rgb);
  aces2_most_light = uintBitsToFloat(texelFetch(table_points, 0).a);
  aces2_white = uintBitsToFloat(texelFetch(table_points, 1).a);
  aces2_saturation = uintBitsToFloat(texelFetch(table_points, 2).a);
  aces2_threshold = uintBitsToFloat(texelFetch(table_points, 3).a);
  aces2_strength = uintBitsToFloat(texelFetch(table_points, 4).a);
  aces2_chroma = uintBitsToFloat(texelFetch(table_points, 5).a);
  aces2_middle = uintBitsToFloat(texelFetch(table_points, 6).a);
  aces2_focus = uintBitsToFloat(texelFetch(table_points, 7).a);
  aces2_bottom = uintBitsToFloat(texelFetch(table_points, 8).a);
  aces2_least_gap = uintBitsToFloat(texelFetch(table_points, 9).a);
}

// Its square, and the inverse of that, are normal numbers.
const float ACES2_TINY = 1.0e-12;

float sum_of_products(vec3 x, vec3 y) { return (x.r * y.r + x.g * y.g) + x.b * y.b; }

vec3 three_sums(vec3 row_r, vec3 row_g, vec3 row_b, vec3 x) {
  return vec3(sum_of_products(row_r, x), sum_of_products(row_g, x), sum_of_products(row_b, x));
}

// 1 over each, by one division: processors divide slowly.
vec3 reciprocals(vec3 x) {
  float rg = x.r * x.g;
  float per_rgb = 1.0 / (rg * x.b);
  float per_rg = per_rgb * x.b;
  return vec3(per_rg * x.g, per_rg * x.r, per_rgb * rg);
}

float with_sign_of(float x, float sign) {
  return uintBitsToFloat(floatBitsToUint(x) | (floatBitsToUint(sign) & 0x80000000u));
}
vec3 with_signs_of(vec3 x, vec3 sign) {
  return vec3(with_sign_of(x.r, sign.r), with_sign_of(x.g, sign.g), with_sign_of(x.b, sign.b));
}

// The response of each cone to its light, and back.
vec3 aces2_responses(vec3 light) {
  vec3 x = abs(light);
  vec3 p = vec3(cone_power(x.r), cone_power(x.g), cone_power(x.b));
  return with_signs_of(400.0 * p * reciprocals(p + 27.13), light);
}
vec3 aces2_lights(vec3 responses) {
  vec3 r = abs(responses);
  vec3 p = 27.13 * r * reciprocals(400.0 - r);
  return with_signs_of(vec3(cone_root(p.r), cone_root(p.g), cone_root(p.b)), responses);
}

// A colour on its way.
struct Aces2Colour {
  float j;      // lightness; of the scene, the achromatic response
  float m;      // colourfulness
  float c;      // the cosine and the sine of the hue
  float s;
  float place;  // of the hue in the table
};

// What depends on the hue alone.
struct Aces2Hue {
  vec3 cusp;    // lightness, colourfulness, the exponent of the hull above it
  float reach;  // the colourfulness of AP1 at the largest lightness
};

// The achromatic response and two opponent ones to light with the primaries of AP1, 0 or more.
vec3 aces2_aab(vec3 ap1) {
  vec3 x = at_most(ap1, aces2_most_light);
  vec3 cones = aces2_responses(three_sums(aces2_to_cone_r, aces2_to_cone_g, aces2_to_cone_b, x));
  return three_sums(aces2_to_aab_r, aces2_to_aab_g, aces2_to_aab_b, cones);
}

Aces2Colour aces2_seen(vec3 aab) {
  Aces2Colour seen;
  seen.j = at_least(aab.r, 0.0);
  seen.m = at_least(sqrt(aab.g * aab.g + aab.b * aab.b), ACES2_TINY);
  // The table is even in an angle that is linear on a diamond.
  float around = at_least(abs(aab.g) + abs(aab.b), ACES2_TINY);
  float per_both = 1.0 / (seen.m * around);
  seen.c = aab.g * per_both * around;
  seen.s = aab.b * per_both * around;
  float q = aab.b * per_both * seen.m;
  seen.place = mix(2.0 - q, q + mix(float(0.0), 4.0, q < 0.0), 0.0 <= aab.g) * float(ACES2_HUES / 4u);
  return seen;
}

Aces2Hue aces2_hue(float place) {
  int below = min(int(place), int(ACES2_HUES) - 1);
  float part = place - float(below);
  uvec4 from = texelFetch(table_points, below + int(ACES2_HUE_BEGIN));
  uvec4 to = texelFetch(table_points, below + int(ACES2_HUE_BEGIN + 1u));
  Aces2Hue hue;
  hue.cusp = mix(uintBitsToFloat(from.rgb), uintBitsToFloat(to.rgb), part);
  hue.reach = mix(uintBitsToFloat(from.a), uintBitsToFloat(to.a), part);
  return hue;
}

// The display's achromatic response to the scene's: cubic pieces.
float aces2_tone(float response) {
  uint bits = floatBitsToUint(response + ACES2_TONE_KNEE);
  uint piece = (bits >> ACES2_TONE_SHIFT) - (floatBitsToUint(ACES2_TONE_KNEE) >> ACES2_TONE_SHIFT) + ACES2_CONSTANTS;
  uint rest = bits & ((1u << ACES2_TONE_SHIFT) - 1u);
  float t = float(int(rest)) * (1.0 / float(1 << ACES2_TONE_SHIFT));
  uvec4 element = texelFetch(table_points, int(piece));
  vec3 c = uintBitsToFloat(element.rgb);
  return ((uintBitsToFloat(element.a) * t + c.b) * t + c.g) * t + c.r;
}

float aces2_chroma_norm(float c, float s) {
  float cc = 2.0 * c * c - 1.0;
  float ccc = c * (2.0 * cc - 1.0);
  float sss = s * (2.0 * cc + 1.0);
  float even = 11.34072 * c + 16.46899 * cc + 7.88380 * ccc + 77.12896;
  return aces2_chroma * (even + s * (14.66441 - 12.74448 * c) + 9.19364 * sss);
}

// Leaves x alone from `limit` on, and bends it towards 0 below.
float aces2_toe(float x, float limit, float k1, float k2, float k3) {
  float minus_b = k3 * x - k1;
  float bent = 0.5 * (minus_b + sqrt(at_least(minus_b * minus_b + 4.0 * k2 * k3 * x, 0.0)));
  return mix(bent, x, limit < x);
}

// Chroma compression of a colour to which the display responds so.
Aces2Colour aces2_toned(Aces2Colour seen, float response, float reach) {
  Aces2Colour toned = seen;
  toned.j = lightness_of(response);
  // Everything in units of the norm's inverse.
  float norm = aces2_chroma_norm(seen.c, seen.s);
  float rest = at_least(1.0 - toned.j, 0.0);
  float inner = norm * sqrt(toned.j * toned.j + aces2_threshold);
  float outer = norm * at_least(rest, 0.001);
  float inner_1 = norm * rest * aces2_saturation;
  float outer_1 = norm * toned.j * aces2_strength;
  inner_1 = sqrt(inner_1 * inner_1 + inner * inner);
  outer_1 = sqrt(outer_1 * outer_1 + outer * outer);
  float limit = response * reach;
  float inner_limit = limit - 0.001 * norm;
  vec3 per = reciprocals(vec3(inner_limit + inner, limit + outer, at_least(seen.j, ACES2_TINY)));
  float chroma = seen.m * (response * aces2_white) * per.b;
  chroma = limit - aces2_toe(limit - chroma, inner_limit, inner_1, inner, (inner_limit + inner_1) * per.r);
  toned.m = aces2_toe(chroma, limit, outer_1, outer, (limit + outer_1) * per.g);
  return toned;
}

// Where the line of compression through (j, m) crosses the grey axis: a numerator and a denominator. `slope` is
// how much steeper than 1 the line is there.
struct Aces2Crossing {
  float over;
  float under;
};
Aces2Crossing aces2_crossing(float j, float slope, float focus, float per_focus) {
  float a = slope * per_focus;
  bool below = j < focus;
  float b = mix(1.0 + slope + a, 1.0 - slope, below);
  float d = mix(slope + j, j, below);
  Aces2Crossing crossing;
  crossing.over = 2.0 * d;
  crossing.under = b + sqrt(at_least(b * b + mix(float(-4.0), 4.0, below) * a * d, 0.0));
  return crossing;
}

// Whether a colour is so far inside of the gamut that compression leaves it alone: its colourfulness is at most
// this part of that of a double cone through the cusp.
bool aces2_well_inside(Aces2Colour toned, Aces2Hue hue) {
  float j = toned.j;
  float most = mix(float(0.37), 0.55, j <= 0.9) * hue.cusp.g;
  return toned.m * hue.cusp.r <= most * j && toned.m * (1.0 - hue.cusp.r) <= most * (1.0 - j) && j <= 0.99;
}

// A line in the plane of a hue towards the grey axis, along which colours are compressed.
struct Aces2Line {
  float source;       // the lightness at which it crosses the axis
  float cusp_source;  // the same of the line through the cusp
  float slope;        // lightness over colourfulness
};

Aces2Line aces2_line(Aces2Colour toned, Aces2Hue hue) {
  float j = toned.j;
  float cusp_j = hue.cusp.r;
  float focus = cusp_j + (aces2_middle - cusp_j) * at_most(1.3 - cusp_j, 1.0);
  float bright = cusp_j + 0.3 * (1.0 - cusp_j);
  float decades = exact_log2((1.0 - bright) / at_least(1.0 - j, aces2_least_gap)) * 0.30103;
  float gain_1 = mix(float(1.0), decades * decades + 1.0, bright < j);
  float per_both = 1.0 / (focus * gain_1);
  float per_focus = gain_1 * per_both;
  float gain = aces2_focus * focus * per_both;
  Aces2Crossing own = aces2_crossing(j, toned.m * gain, focus, per_focus);
  Aces2Crossing cusp = aces2_crossing(cusp_j, hue.cusp.g * gain, focus, per_focus);
  float per_under = 1.0 / (own.under * cusp.under);
  Aces2Line line;
  line.source = own.over * cusp.under * per_under;
  line.cusp_source = cusp.over * own.under * per_under;
  line.slope = mix(1.0 - line.source, line.source, line.source < focus) * (line.source - focus) * gain * per_focus;
  return line;
}

// Compression into the display's gamut.
Aces2Colour aces2_fitted(Aces2Colour toned, Aces2Hue hue, Aces2Line line) {
  float j = toned.j;
  float m = toned.m;
  float source = line.source;
  float cusp_source = line.cusp_source;
  vec3 per = reciprocals(vec3(hue.cusp.g, hue.reach, cusp_source * (1.0 - cusp_source)));

  // Three hulls, each a power of lightness: the display's below its cusp and above it, and AP1's.
  vec3 steep = vec3(hue.cusp.r * per.r - line.slope, (1.0 - hue.cusp.r) * per.r + line.slope, per.g - line.slope);
  vec3 gentle = reciprocals(at_least(steep, 1.0e-6));
  float below = power(source * (1.0 - cusp_source) * per.b, aces2_bottom);
  float above = power(at_least((1.0 - source) * cusp_source * per.b, 0.0), hue.cusp.b);
  float lower = cusp_source * below * gentle.r;
  float upper = (1.0 - cusp_source) * above * gentle.g;
  float reach = achromatic_of(source) * gentle.b;
  float near = at_least(0.12 - abs(lower - upper) * per.r, 0.0);
  float boundary = min(lower, upper) - near * near * near * (hue.cusp.g * (1.0 / (6.0 * 0.12 * 0.12)));

  float threshold = max(boundary * boundary / at_least(reach, ACES2_TINY), 0.75 * boundary);
  float beyond = m - threshold;
  float far = (boundary - threshold) * (reach - threshold);
  float compressed = threshold + beyond * far / (far + beyond * (reach - boundary));
  bool none = boundary <= 0.0 || 1.0 < j;
  float fitted_m = mix(mix(m, compressed, boundary < reach && threshold < m), 0.0, none);
  float fitted_j = mix(source + fitted_m * line.slope, j, none);
  // So the bits do not depend on whether other colours have to be compressed.
  bool inside = aces2_well_inside(toned, hue);
  Aces2Colour fitted = toned;
  fitted.m = mix(fitted_m, m, inside);
  fitted.j = mix(fitted_j, j, inside);
  return fitted;
}

// The display light of a colour, with the limiting primaries, 1 at the peak.
vec3 aces2_shown(Aces2Colour colour) {
  vec3 aab = vec3(achromatic_of(colour.j), colour.m * colour.c, colour.m * colour.s);
  vec3 light = aces2_lights(three_sums(aces2_from_aab_r, aces2_from_aab_g, aces2_from_aab_b, aab));
  return three_sums(aces2_to_rgb_r, aces2_to_rgb_g, aces2_to_rgb_b, light);
}

vec3 aces2(vec3 ap1) {
  Aces2Colour seen = aces2_seen(aces2_aab(ap1));
  Aces2Hue hue = aces2_hue(seen.place);
  Aces2Colour toned = aces2_toned(seen, aces2_tone(seen.j), hue.reach);
  return aces2_shown(aces2_fitted(toned, hue, aces2_line(toned, hue)));
}
