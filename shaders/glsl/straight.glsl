// Straight alpha (docs/pipeline.md section 5): a pixel's light is that of an object that covers a part of it,
// and light of its own. This file is C++, too: server/render/host/lanes-inl.h says what that asks for.

struct StraightLight {
  vec3 object;  // divided by alpha
  vec3 own;
};

// With a = 1 the object has the bits of `exposed`.
StraightLight straight_light(vec3 exposed, float a) {
  const float nothing = 1.0e-30;
  bool whole = a == 1.0;
  float rest = 1.0 - a;
  vec3 size = abs(exposed);
  // One factor for all components, so that neither part has another hue.
  float largest = max(max(max(size.r, size.g), size.b), nothing);
  float kept = mix(min(MAX_OBJECT_LIGHT * a / rest / largest, 1.0), 1.0, whole);
  vec3 object = exposed * kept;
  StraightLight light;
  light.own = exposed - object;
  light.object = mix(object / at_least(a, nothing), exposed, bvec3(whole));
  return light;
}

struct StraightPixel {
  vec3 colour;
  float alpha;
};

// The pixel of a light whose object and own part are shown so; `black` is how no light is shown.
StraightPixel straight_pixel(StraightLight light, vec3 object_shown, vec3 own_shown, vec3 black, float a) {
  const float nothing = 1.0e-30;
  bool whole = a == 1.0;
  float rest = 1.0 - a;
  vec3 own = mix(at_least(own_shown - black, 0.0), vec3(0.0), bvec3(light.own == vec3(0.0)));
  vec3 colour = a * object_shown + rest * own;
  float alpha = a + rest * max(max(own.r, own.g), own.b);
  bool absent = alpha < nothing;
  StraightPixel pixel;
  pixel.colour = mix(mix(at_most(colour / alpha, 1.0), vec3(0.0), bvec3(absent)), colour, bvec3(whole));
  pixel.alpha = mix(mix(alpha, 0.0, absent), 1.0, whole);
  return pixel;
}
