// The rays of a view, and the light of spheres (docs/environments.md section 6). The including shader has its
// parameters as `p`. This file is C++, too: server/render/host/lanes-inl.h says what that asks for.
//
// Which objects are met follows from multiplications and additions alone, each of them rounded: a product in
// float() is.

// The ray through (x, y), in camera axes. Not of length 1; its z is -1.
vec3 ray(float x, float y) {
  precise float across = (x - 0.5 * float(p.width)) * p.pixel;
  precise float up = (0.5 * float(p.height) - y) * p.pixel;
  return vec3(across, up, -1.0);
}

// In the environment's axes.
vec3 turned(vec3 d) {
  return vec3(p.m00 * d.r + p.m01 * d.g + p.m02 * d.b, p.m10 * d.r + p.m11 * d.g + p.m12 * d.b,
              p.m20 * d.r + p.m21 * d.g + p.m22 * d.b);
}

float squared(vec3 d) {
  precise float length2 = (float(d.r * d.r) + float(d.g * d.g)) + float(d.b * d.b);
  return length2;
}

// Half the log2 of a ray's solid angle over a texel's of level 0. `size` is the largest component of the
// direction that is looked up, and the ray's own length if that direction has length 1.
float lod_of(float size) { return p.lod - 1.5 * log2(size); }

// Whether a ray meets a sphere, and how many times d that is away.
struct Meeting {
  bool hit;
  float away;
};

// `o` is from the centre to the camera, `length2` the square of d's length.
Meeting meeting_of(vec3 o, float radius_squared, float to_surface, vec3 d, float length2) {
  precise float along = (float(o.r * d.r) + float(o.g * d.g)) + float(o.b * d.b);
  precise vec3 across = vec3(float(o.g * d.b) - float(o.b * d.g), float(o.b * d.r) - float(o.r * d.b),
                             float(o.r * d.g) - float(o.g * d.r));
  precise float limit = radius_squared * length2;
  precise float room = limit - squared(across);
  Meeting meeting;
  meeting.hit = along < 0.0 && squared(across) <= limit;
  meeting.away = to_surface / (sqrt(max(room, 0.0)) - along);
  return meeting;
}

// A sphere where a ray meets it.
struct Surface {
  vec3 n;
  float nov;
  vec3 mirrored;  // the unit direction in which the ray goes on
  float size;     // the ray's length
  float spread;   // how far the sphere spreads rays: half the log2 of a factor on the solid angle
};

Surface surface_at(vec3 o, float inverse_radius, vec3 d, float away) {
  Surface surface;
  surface.size = sqrt(squared(d));
  vec3 toward = d / surface.size;
  surface.n = normalize(o + away * d);
  surface.nov = clamp(-dot(surface.n, toward), 0.0, 1.0);
  surface.mirrored = reflect(toward, surface.n);
  float q = max(surface.nov, 0.001);
  float bend = 2.0 * away * surface.size * inverse_radius;
  surface.spread = 0.5 * log2((1.0 + bend * q) * (1.0 + bend / q));
  return surface;
}

// What Irr(n) multiplies with the coefficients of ViewLight, for a unit direction in the environment's axes.
struct HarmonicFactors {
  float of[9];
};

HarmonicFactors harmonic_factors(vec3 n) {
  HarmonicFactors factors;
  factors.of[0] = 1.0;
  factors.of[1] = n.g;
  factors.of[2] = n.b;
  factors.of[3] = n.r;
  factors.of[4] = n.r * n.g;
  factors.of[5] = n.g * n.b;
  factors.of[6] = 3.0 * n.b * n.b - 1.0;
  factors.of[7] = n.r * n.b;
  factors.of[8] = n.r * n.r - n.g * n.g;
  return factors;
}

// The column of the BRDF table for n.v: its whole part is the left one of two.
float brdf_column(float nov) {
  return clamp(nov * float(BRDF_SIZE) - 0.5, 0.0, float(BRDF_SIZE) - 1.0);
}

// Of the light that a sphere reflects, and of Irr(n). `scale` and `bias` are the BRDF table's.
vec3 light_of_surface(vec3 reflected, vec3 irradiance, vec3 f0, vec3 diffuse, float scale, float bias) {
  vec3 f = f0 * scale + bias;
  vec3 scattered = diffuse * irradiance * (1.0 - f);
  return reflected * f + scattered;
}
