// Tone curves (docs/pipeline.md section 5): exposed scene light to display-linear light in [0, 1]. The
// including shader declares CURVE and includes transfer.glsl and table.glsl. This file is C++, too:
// server/render/host/lanes-inl.h says what that asks for.
//
// A curve has two parts: curve_light() takes the scene's Rec.709 to the curve's own primaries, and curve()
// does the rest. Between them the light is cut at 0.
//
// Sources:
// reinhard, reinhard-extended, the upper half of shoulder: E. Reinhard et al., "Photographic Tone Reproduction for Digital Images", 2002.
// aces-narkowicz: K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2016.
// aces-hill: S. Hill's fit of the ACES RRT and ODT, published in M. Pettineo's BakingLab.
// hable: J. Hable, "Filmic Tonemapping Operators", 2010.
// agx: T. Sobotka's AgX, inset and base curve.
// pbr-neutral: Khronos PBR Neutral Tone Mapper, 2024.
// aces-2: aces2.glsl. bt2390: hdr.glsl.

// S. Hill's published fit of the ACES RRT and ODT, in the fit's own primaries.
vec3 rrt_and_odt(vec3 v) {
  return (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081);
}

// Exposed light in the primaries in which the curve works, component by component. No matrix has a negative
// number, so light that is not negative stays so. For PQ and HLG they are the display's.
vec3 curve_light(vec3 x) {
  if (CURVE == CURVE_ACES_HILL || CURVE == CURVE_ACES_1 || CURVE == CURVE_TABLE) {
    return rows(TABLE_FROM_SCENE, x);
  }
  if (CURVE == CURVE_TABLE_AP1 || CURVE == CURVE_ACES_2) return rows(TABLE_FROM_SCENE_AP1, x);
  if (CURVE == CURVE_AGX) return rows(AGX_INSET, x);
  if (CURVE == CURVE_LINEAR || CURVE == CURVE_BT2390) return to_display(x);
  return x;
}

// A saturated light beyond the end of the axes brightens the other components, as the RRT's desaturation does.
vec3 within_axes(vec3 v) {
  vec3 beyond = at_least(v - p.table_end, 0.0) * vec3(RRT_DESATURATION);
  return at_most(v, p.table_end) + vec3(beyond.g + beyond.b, beyond.r + beyond.b, beyond.r + beyond.g);
}

// aces-hill's last matrix is that of the colour tables.
vec3 from_table(vec3 v) { return rows(TABLE_TO_DISPLAY, v); }

// The published difference over one denominator, with A (1 - E/F) = 0.14 and B (C - E/F) = 1/60. Its constant
// terms cancel, so black is 0 on every device.
vec3 hable_base(vec3 x) {
  return x * (0.14 * x + 1.0 / 60.0) / (x * (0.15 * x + 0.50) + 0.20 * 0.30);
}

// The linear white is 11.2 and the exposure bias is 2, as published.
vec3 hable(vec3 x) { return hable_base(2.0 * x) / hable_base(vec3(11.2)); }

// AgX's base curve is a function of log2 of the light, from -12.47393 to 4.026069, as a number from 0 to 1.
float agx_stops(float inset) {
  float stops = exact_log2(at_least(inset, 1.0e-10));
  return at_most(at_least((stops + 12.47393) * (1.0 / (4.026069 + 12.47393)), 0.0), 1.0);
}

// It has slope 2 at (10/16.5, 0.5), a toe t / (1 + t^3)^(1/3) below, and a shoulder t / (1 + t^3.25)^(1/3.25)
// above. t is slope * distance / scale.
float agx_base(float x) {
  const float pivot = 10.0 / 16.5;
  bool above = pivot < x;
  // With these scales the curve ends at (0, 0) and (1, 1).
  float scale = mix(float(-0.51227738), 0.54146416, above);
  float t = (x - pivot) * mix(float(2.0 / -0.51227738), 2.0 / 0.54146416, above);
  float one_more = 1.0 + t * t * t * mix(float(1.0), sqrt(sqrt(t)), above);
  float bent = t * exact_exp2(exact_log2(one_more) * mix(float(-1.0 / 3.0), -1.0 / 3.25, above));
  return at_least(0.5 + scale * bent, 0.0);
}

float agx_light(float base) { return power(base, 2.2); }

float agx_channel(float inset) { return agx_light(agx_base(agx_stops(inset))); }

vec3 agx(vec3 inset) { return vec3(agx_channel(inset.r), agx_channel(inset.g), agx_channel(inset.b)); }

vec3 pbr_neutral(vec3 x) {
  const float start = 0.8 - 0.04;
  const float range = 1.0 - start;
  float least = min(min(x.r, x.g), x.b);
  x -= mix(0.04, least - 6.25 * least * least, least < 0.08);
  float peak = max(max(x.r, x.g), x.b);
  float new_peak = 1.0 - range * range / (peak + range - start);
  float desaturated = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0);
  return mix(mix(x * (new_peak / peak), vec3(new_peak), desaturated), x, bvec3(peak < start));
}

// A brighter display's light, up to `peak`, where white is 1. One factor for the three components keeps their hue.
// Up to half of white it is 1. Above it the largest component follows Reinhard's extended curve, which has slope 1
// there and ends at white.
vec3 shoulder(vec3 x, float peak) {
  float largest = max(max(x.r, x.g), x.b);
  float end = 2.0 * peak - 1.0;
  float u = at_most(2.0 * largest - 1.0, end);
  float shown = 0.5 + 0.5 * u * (1.0 + u / (end * end)) / (1.0 + u);
  return x * mix(shown / at_least(largest, 0.5), 1.0, largest < 0.5);
}

// The tone curve of curve_light() x >= 0, clamped to [0, 1]. `white` is curve_white of the parameters.
vec3 curve(vec3 x, float white) {
  vec3 y = x;
  if (CURVE == CURVE_REINHARD) y = x / (1.0 + x);
  if (CURVE == CURVE_REINHARD_EXTENDED) {
    float l = luminance(x);
    y = x * ((1.0 + l / (white * white)) / (1.0 + l));
  }
  if (CURVE == CURVE_ACES_NARKOWICZ) y = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
  if (CURVE == CURVE_ACES_HILL) y = rows(TABLE_TO_DISPLAY, rrt_and_odt(x));
  if (CURVE == CURVE_HABLE) y = hable(x);
  if (CURVE == CURVE_AGX) y = agx(x);
  if (CURVE == CURVE_PBR_NEUTRAL) y = pbr_neutral(x);
  if (CURVE == CURVE_SHOULDER) y = shoulder(x, white);
  if (CURVE == CURVE_BT2390) y = bt2390(x, white, p.peak_signal, p.display_peak);
  if (CURVE == CURVE_ACES_1 || CURVE == CURVE_TABLE) y = from_table(look_up(x));
  if (CURVE == CURVE_TABLE_AP1) y = from_table(look_up(within_axes(x)));
  if (CURVE == CURVE_TABLE_REC709) y = look_up(x);
  return at_most(at_least(y, 0.0), 1.0);
}
