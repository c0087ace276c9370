// A view of an environment: the sky, and spheres in front of it.
//
// In: the chain, the specular levels, the BRDF table, and a ViewScene by its address. Out: rows of RGBA
// halves, as they would arrive on the wire.
// Method: docs/environments.md section 6, in camera axes. Only directions that are looked up are turned into
// the axes of the environment. Tiles that no sphere can touch run without OBJECTS.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"
#include "glsl/environment.glsl"

layout(local_size_x = VIEW_TILE_X, local_size_y = VIEW_TILE_Y) in;
layout(constant_id = 0) const bool OBJECTS = false;
layout(constant_id = 1) const bool MAGNIFIED = false;
layout(set = 0, binding = 0) uniform utextureBuffer chain;
layout(set = 0, binding = 1) uniform utextureBuffer specular;
layout(set = 0, binding = 2) uniform utextureBuffer brdf;
layout(push_constant) uniform Push { ViewParams p; };
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer Scene { ViewScene v; };

const int SKY = -1;

// The ray through (x, y), in camera axes. Not of length 1; its z is -1.
vec3 ray(float x, float y) {
  precise float across = (x - 0.5 * float(p.width)) * p.pixel;
  precise float up = (0.5 * float(p.height) - y) * p.pixel;
  return vec3(across, up, -1.0);
}

vec3 turned(vec3 d) {
  return vec3(p.m00 * d.x + p.m01 * d.y + p.m02 * d.z, p.m10 * d.x + p.m11 * d.y + p.m12 * d.z,
              p.m20 * d.x + p.m21 * d.y + p.m22 * d.z);
}

float squared(vec3 d) {
  precise float length2 = (d.x * d.x + d.y * d.y) + d.z * d.z;
  return length2;
}

// The object that the ray meets first, or SKY, and how many times d it is away. Which objects are met
// follows from multiplications and additions alone.
int object_at(Scene scene, vec3 d, out float nearest) {
  int found = SKY;
  nearest = uintBitsToFloat(0x7f800000u);
  float length2 = squared(d);
  for (uint k = 0u; k < p.objects; ++k) {
    vec3 o = vec3(scene.v.objects[k].ox, scene.v.objects[k].oy, scene.v.objects[k].oz);
    precise float along = (o.x * d.x + o.y * d.y) + o.z * d.z;
    precise vec3 across = vec3(o.y * d.z - o.z * d.y, o.z * d.x - o.x * d.z, o.x * d.y - o.y * d.x);
    precise float limit = scene.v.objects[k].radius_squared * length2;
    precise float room = limit - squared(across);
    bool hit = along < 0.0 && squared(across) <= limit;
    float away = scene.v.objects[k].to_surface / (sqrt(max(room, 0.0)) - along);
    if (hit && away < nearest) {
      nearest = away;
      found = int(k);
    }
  }
  return found;
}

vec2 brdf_pair(int x, int y) {
  int at = y * int(BRDF_SIZE) + x;
  return unpackHalf2x16(texelFetch(brdf, at / 4)[at & 3]);
}

// (scale, bias), bilinear.
vec2 brdf_at(float nov, float roughness) {
  const float end = float(BRDF_SIZE) - 1.0;
  float x = clamp(nov * float(BRDF_SIZE) - 0.5, 0.0, end);
  float y = clamp(roughness * float(BRDF_SIZE) - 0.5, 0.0, end);
  int left = int(x);
  int top = int(y);
  int right = min(left + 1, int(end));
  int bottom = min(top + 1, int(end));
  vec2 above = mix(brdf_pair(left, top), brdf_pair(right, top), x - float(left));
  vec2 below = mix(brdf_pair(left, bottom), brdf_pair(right, bottom), x - float(left));
  return mix(above, below, y - float(top));
}

vec3 irradiance_term(Scene scene, uint i) {
  return vec3(scene.v.irradiance[3u * i], scene.v.irradiance[3u * i + 1u], scene.v.irradiance[3u * i + 2u]);
}

// Irr(n), for a unit direction in the environment's axes.
vec3 irradiance(Scene scene, vec3 n) {
  float factors[9] = {1.0, n.y, n.z, n.x, n.x * n.y, n.y * n.z, 3.0 * n.z * n.z - 1.0, n.x * n.z,
                      n.x * n.x - n.y * n.y};
  vec3 sum = vec3(0.0);
  [[unroll]] for (uint i = 0u; i < 9u; ++i) sum += factors[i] * irradiance_term(scene, i);
  return max(sum, vec3(0.0));
}

// Half the log2 of a ray's solid angle over a texel's of level 0. `size` is the largest component of the
// direction that is looked up, and the ray's own length if that direction has length 1.
float lod_of(float size) { return p.lod - 1.5 * log2(size); }

vec3 sky(vec3 d) {
  CubePlace place = cube_place(turned(d));
  if (MAGNIFIED) return cube_at(chain, CUBE_LEVEL_START(p.chain_size, p.chain_size, 0u), p.chain_size, place);
  return chain_at(chain, p.chain_size, p.chain_last, place, max(0.0, lod_of(place.size)));
}

// What is seen along a ray in a tile with objects.
vec3 light(Scene scene, vec3 d) {
  float away;
  int found = object_at(scene, d, away);
  if (found == SKY) away = 1.0;  // only so that what follows stays finite
  uint k = uint(max(found, 0));
  float length_d = sqrt(squared(d));
  vec3 toward = d / length_d;
  vec3 o = vec3(scene.v.objects[k].ox, scene.v.objects[k].oy, scene.v.objects[k].oz);
  float inverse_radius = scene.v.objects[k].inverse_radius;
  vec3 n = normalize(o + away * d);
  float nov = clamp(-dot(n, toward), 0.0, 1.0);
  float q = max(nov, 0.001);
  float bend = 2.0 * away * length_d * inverse_radius;
  float spread = 0.5 * log2((1.0 + bend * q) * (1.0 + bend / q));

  CubePlace place = cube_place(turned(found == SKY ? d : reflect(toward, n)));
  float lod = found == SKY ? lod_of(place.size) : lod_of(place.size * length_d) + spread;
  vec3 mirrored = chain_at(chain, p.chain_size, p.chain_last, place, max(0.0, lod));
  vec3 rough = scene.v.objects[k].near_weight *
                   cube_at(specular, scene.v.objects[k].near_start, scene.v.objects[k].near_size, place) +
               scene.v.objects[k].far_weight *
                   cube_at(specular, scene.v.objects[k].far_start, scene.v.objects[k].far_size, place);
  vec3 reflected = scene.v.objects[k].chain_weight * mirrored + rough;
  vec2 pair = brdf_at(nov, scene.v.objects[k].roughness);
  vec3 f0 = vec3(scene.v.objects[k].f0_r, scene.v.objects[k].f0_g, scene.v.objects[k].f0_b);
  vec3 f = f0 * pair.x + pair.y;
  vec3 diffuse =
      vec3(scene.v.objects[k].diffuse_r, scene.v.objects[k].diffuse_g, scene.v.objects[k].diffuse_b) *
      irradiance(scene, turned(n)) * (1.0 - f);
  return found == SKY ? mirrored : reflected * f + diffuse;
}

// A pixel with its upper left corner at (x, y).
vec3 pixel(float x, float y) {
  if (!OBJECTS) return sky(ray(x + 0.5, y + 0.5));
  Scene scene = Scene(uvec2(p.scene_lo, p.scene_hi));
  uint side = p.samples_side;
  float step_ = 1.0 / float(side);
  float away;
  int centre = object_at(scene, ray(x + 0.5, y + 0.5), away);
  bool mixed = false;
  for (uint k = 0u; side > 1u && k < side * side; ++k) {
    float a = (float(k % side) + 0.5) * step_;
    float b = (float(k / side) + 0.5) * step_;
    mixed = mixed || object_at(scene, ray(x + a, y + b), away) != centre;
  }
  uint count = mixed ? side * side : 1u;
  vec3 sum = vec3(0.0);
  for (uint k = 0u; k < count; ++k) {
    float a = mixed ? (float(k % side) + 0.5) * step_ : 0.5;
    float b = mixed ? (float(k / side) + 0.5) * step_ : 0.5;
    sum += light(scene, ray(x + a, y + b));
  }
  return sum / float(count);
}

void main() {
  uint x = gl_GlobalInvocationID.x;
  uint y = gl_GlobalInvocationID.y;
  if (x >= p.pitch || y >= p.height) return;
  vec3 c = clamp(pixel(float(x), float(y)), -MAX_SCENE_VALUE, MAX_SCENE_VALUE);
  vec4 texel = round_to_half(x < p.width ? vec4(c, 1.0) : vec4(0.0));
  uint at = (y - p.first_row) * p.pitch + x;
  written[at / 2u][at & 1u] = pack64(uvec2(packHalf2x16(texel.rg), packHalf2x16(texel.ba)));
}
