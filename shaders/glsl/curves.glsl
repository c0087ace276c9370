// Tone curves (docs/pipeline.md section 5): exposed scene light to display-linear light in [0, 1]. The
// including shader declares CURVE and includes transfer.glsl and table.glsl.
//
// Sources: reinhard, reinhard-extended: E. Reinhard et al., "Photographic Tone Reproduction for Digital
// Images",
// 2002. aces-narkowicz: K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2016. aces-hill: S. Hill's fit of the
// ACES RRT and ODT, published in M. Pettineo's BakingLab. hable: J. Hable, "Filmic Tonemapping Operators",
// 2010. agx: T. Sobotka's AgX, inset and base curve. pbr-neutral: Khronos PBR Neutral Tone Mapper, 2024.

// S. Hill's published fit of the ACES RRT and ODT, in the fit's own primaries.
vec3 rrt_and_odt(vec3 v) {
  return (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081);
}

vec3 rows(float m[9], vec3 x) {
  return vec3(m[0] * x.r + m[1] * x.g + m[2] * x.b, m[3] * x.r + m[4] * x.g + m[5] * x.b,
              m[6] * x.r + m[7] * x.g + m[8] * x.b);
}

// Uses the same matrices as the colour tables.
vec3 aces_hill(vec3 x) {
  vec3 v = rrt_and_odt(rows(float[](TABLE_FROM_SCENE), x));
  return rows(float[](TABLE_TO_DISPLAY), v);
}

vec3 table(vec3 x) { return rows(float[](TABLE_TO_DISPLAY), look_up(rows(float[](TABLE_FROM_SCENE), x))); }

vec3 hable_base(vec3 x) {
  return (x * (0.15 * x + 0.10 * 0.50) + 0.20 * 0.02) / (x * (0.15 * x + 0.50) + 0.20 * 0.30) - 0.02 / 0.30;
}

// The linear white is 11.2 and the exposure bias is 2, as published.
vec3 hable(vec3 x) { return hable_base(2.0 * x) / hable_base(vec3(11.2)); }

// The two sides of AgX's base curve, which has slope 2 at (10/16.5, 0.5). t = slope * distance / scale.
float agx_toe(float t) { return t / power(1.0 + t * t * t, 1.0 / 3.0); }
float agx_shoulder(float t) { return t / power(1.0 + t * t * t * sqrt(sqrt(t)), 1.0 / 3.25); }

float agx_channel(float inset) {
  const float pivot = 10.0 / 16.5;
  float stops = exact_log2(at_least(inset, 1.0e-10));
  float x = at_most(at_least((stops + 12.47393) / (4.026069 + 12.47393), 0.0), 1.0);
  // With these scales the curve ends at (0, 0) and (1, 1).
  const float toe = 0.51227738;
  const float shoulder = 0.54146416;
  float below = agx_toe(at_least(2.0 * (pivot - x) / toe, 0.0));
  float above = agx_shoulder(at_least(2.0 * (x - pivot) / shoulder, 0.0));
  return power(at_least(0.5 - toe * below + shoulder * above, 0.0), 2.2);
}

vec3 agx(vec3 x) {
  return vec3(agx_channel(0.842479062253094 * x.r + 0.0784335999999992 * x.g + 0.0792237451477643 * x.b),
              agx_channel(0.0423282422610123 * x.r + 0.878468636469772 * x.g + 0.0791661274605434 * x.b),
              agx_channel(0.0423756549057051 * x.r + 0.0784336 * x.g + 0.879142973793104 * x.b));
}

vec3 pbr_neutral(vec3 x) {
  const float start = 0.8 - 0.04;
  const float range = 1.0 - start;
  float least = min(min(x.r, x.g), x.b);
  x -= least < 0.08 ? least - 6.25 * least * least : 0.04;
  float peak = max(max(x.r, x.g), x.b);
  if (peak < start) return x;
  float new_peak = 1.0 - range * range / (peak + range - start);
  float desaturated = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0);
  return mix(x * (new_peak / peak), vec3(new_peak), desaturated);
}

// The tone curve of exposed light x, clamped to [0, 1]. `white` is the luminance that reinhard-extended maps
// to 1.
vec3 curve(vec3 x, float white) {
  vec3 y = x;
  if (CURVE == CURVE_REINHARD) y = x / (1.0 + x);
  if (CURVE == CURVE_REINHARD_EXTENDED) {
    float l = luminance(x);
    y = x * ((1.0 + l / (white * white)) / (1.0 + l));
  }
  if (CURVE == CURVE_ACES_NARKOWICZ) y = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
  if (CURVE == CURVE_ACES_HILL) y = aces_hill(x);
  if (CURVE == CURVE_HABLE) y = hable(x);
  if (CURVE == CURVE_AGX) y = agx(x);
  if (CURVE == CURVE_PBR_NEUTRAL) y = pbr_neutral(x);
  if (CURVE == CURVE_ACES_1 || CURVE == CURVE_TABLE) y = table(x);
  if (CURVE == CURVE_TABLE_REC709) y = look_up(x);
  return at_most(at_least(y, 0.0), 1.0);
}
