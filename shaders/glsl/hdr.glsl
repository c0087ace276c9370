// Displays of high dynamic range (docs/pipeline.md section 5): primaries, PQ and HLG, and the curve bt2390.
// Light is in units of the display's peak. Sources: SMPTE ST 2084, ITU-R BT.2100, ITU-R BT.2390.
//
// The including shader declares DISPLAY and includes log2.glsl. This file is C++, too:
// server/render/host/lanes-inl.h says what that asks for.

// A matrix, row by row, times x.
vec3 rows(float m00, float m01, float m02, float m10, float m11, float m12, float m20, float m21, float m22,
          vec3 x) {
  return vec3(m00 * x.r + m01 * x.g + m02 * x.b, m10 * x.r + m11 * x.g + m12 * x.b,
              m20 * x.r + m21 * x.g + m22 * x.b);
}

// From Rec.709 to the display's primaries.
vec3 to_display(vec3 x) {
  if (DISPLAY == DISPLAY_REC2020) return rows(REC709_TO_REC2020, x);
  if (DISPLAY == DISPLAY_P3_D65) return rows(REC709_TO_P3_D65, x);
  return x;
}

// From P3-D65 to Rec.2020, 0 .. 1.
vec3 p3_in_rec2020(vec3 x) { return at_most(at_least(rows(P3_D65_TO_REC2020, x), 0.0), 1.0); }

// log2(1 + z) / z.
// fit: z in [-0.164062, 0], degree 5, error 2.2e-08, best 3.4e-09
float log2_over(float z) {
  float q = 0.260617137 - 0.377793551 * z;
  q = q * z - 0.363174111;
  q = q * z + 0.480798841;
  q = q * z - 0.721348941;
  q = q * z + 1.44269502;
  return q;
}

// The PQ signal of light in units of 10000 nit, 0 .. 1. 1 + z is ST 2084's (c1 + c2 y) / (1 + c3 y): so nothing
// cancels, and a power of 79 does not enlarge a rounding.
float pq(float light) {
  float y = power(light, 0.1593017578125);
  float z = 0.1640625 * (y - 1.0) / (1.0 + 18.6875 * y);
  return at_most(exact_exp2(78.84375 * z * log2_over(z)), 1.0);
}

// The light of a PQ signal.
float pq_light(float signal) {
  float p = power(signal, 1.0 / 78.84375);
  return power(at_least(p - 0.8359375, 0.0) / (18.8515625 - 18.6875 * p), 1.0 / 0.1593017578125);
}

// HLG's OETF of light before the OOTF, 0 or more.
float hlg_oetf(float e) {
  float high = 0.12395743 * exact_log2(at_least(12.0 * e - 0.28466892, 0.5)) + 0.55991073;
  return at_most(mix(high, sqrt(3.0 * e), e <= 1.0 / 12.0), 1.0);
}

float display_luminance(vec3 x) {
  if (DISPLAY == DISPLAY_P3_D65) return (0.228974564 * x.r + 0.691738522 * x.g) + 0.079286914 * x.b;
  return (0.262700212 * x.r + 0.677998072 * x.g) + 0.059301716 * x.b;
}

// The HLG signal of display light.
vec3 hlg(vec3 light, float exponent) {
  float scene = exact_exp2(exact_log2(at_least(display_luminance(light), 1.0e-30)) * exponent);
  return vec3(hlg_oetf(light.r * scene), hlg_oetf(light.g * scene), hlg_oetf(light.b * scene));
}

// BT.2390's EETF from a source of a peak with the PQ signal `source` to a display whose peak is `display_peak` and
// has the signal `peak`. One factor for the three components, by the largest of them. The result is at most 1.
vec3 bt2390(vec3 x, float source, float peak, float display_peak) {
  float largest = max(max(x.r, x.g), x.b);
  float signal = at_most(pq(at_most(largest * display_peak, 1.0)), source);
  float most = peak / source;
  // A source as bright as the display has its knee at the end, where the signals differ by roundings.
  float range = at_least(1.5 - 1.5 * most, 1.0e-6);
  float knee = 1.0 - range;
  float e = signal / source;
  float t = at_most(at_least((e - knee) / range, 0.0), 1.0);
  float tt = t * t;
  // Hermite: from the knee with slope 1 to `most` with slope 0.
  float bent = knee + range * (t * (1.0 - t) * (1.0 - t)) + (most - knee) * (tt * (3.0 - 2.0 * t));
  float shown = at_most(pq_light(bent * source) / display_peak, 1.0);
  float factor = mix(shown / at_least(largest, 1.0e-30), 1.0, e < knee);
  return at_most(x * factor, 1.0);
}
