// A view of an environment: the sky, and spheres in front of it.
//
// In: the chain, the specular levels, and the scene: a ViewLight and ViewObjects. Out: rows of RGBA halves, or
// with FLOATS floats, as they would arrive on the wire.
// Method: docs/environments.md section 6, in camera axes. Only directions that are looked up are turned into
// the axes of the environment. The sky is drawn everywhere. After it, OBJECTS draws the pixels of objects, in
// tiles that they may touch. Loops test at their end: the software device runs the body of a loop that tests
// at its beginning once more than needed.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "glsl/common.glsl"
#include "glsl/environment.glsl"

layout(local_size_x = VIEW_TILE, local_size_y = VIEW_TILE) in;
layout(constant_id = 0) const bool OBJECTS = false;
layout(constant_id = 1) const bool MAGNIFIED = false;
layout(constant_id = 2) const bool SHARP = true;
layout(constant_id = 3) const bool ROUGH = true;
layout(constant_id = 4) const bool SAMPLES = true;
layout(constant_id = 5) const bool FLOATS = false;
layout(set = 0, binding = 0) uniform utextureBuffer chain;
layout(set = 0, binding = 1) uniform utextureBuffer specular;
layout(set = 0, binding = 2) uniform utextureBuffer scene;
layout(push_constant) uniform Push { ViewParams pushed; };

const int SKY = -1;
const uint VIEW_LIGHT_TEXELS = 9u;
const uint VIEW_OBJECT_TEXELS = 5u + BRDF_SIZE;

// The parameters. main() reads them before any branch. Behind a branch the software device reads each of them
// lane by lane, with 25 instructions.
ViewParams p;

#include "glsl/view.glsl"

uvec4 object_words(int k, uint i) {
  return texelFetch(scene, int(VIEW_LIGHT_TEXELS + uint(k) * VIEW_OBJECT_TEXELS + i));
}

// The object that the ray meets first, or SKY, and how many times d it is away.
int object_at(vec3 d, out float nearest) {
  int found = SKY;
  nearest = uintBitsToFloat(0x7f800000u);
  float length2 = squared(d);
  int k = int(p.first_object);
  do {
    vec4 sphere = uintBitsToFloat(object_words(k, 0u));
    float to_surface = uintBitsToFloat(object_words(k, 1u).x);
    Meeting meeting = meeting_of(sphere.xyz, sphere.w, to_surface, d, length2);
    if (meeting.hit && meeting.away < nearest) {
      nearest = meeting.away;
      found = k;
    }
  } while (++k < int(p.end_object));
  return found;
}

// (scale, bias) of object k, linear in n.v. Its roughness is constant, so the host interpolates along it.
vec2 brdf_at(int k, float nov) {
  float x = brdf_column(nov);
  float left = floor(x);
  vec4 pairs = uintBitsToFloat(object_words(k, 5u + uint(left)));
  return mix(pairs.xy, pairs.zw, x - left);
}

// Irr(n), for a unit direction in the environment's axes.
vec3 irradiance(vec3 n) {
  HarmonicFactors factors = harmonic_factors(n);
  vec3 sum = vec3(0.0);
  [[unroll]] for (int i = 0; i < 9; ++i) sum += factors.of[i] * uintBitsToFloat(texelFetch(scene, i).rgb);
  return max(sum, vec3(0.0));
}

// What is seen along a ray that meets object `found` at `away` times d, or the sky.
vec3 light(vec3 d, int found, float away) {
  if (found == SKY) away = 1.0;  // only so that what follows stays finite
  int k = max(found, 0);
  vec4 weights = uintBitsToFloat(object_words(k, 1u));  // to_surface, inverse_radius, chain and near weight
  uvec4 f0_far = object_words(k, 2u);
  uvec4 diffuse_near = object_words(k, 3u);
  uvec4 levels = object_words(k, 4u);
  Surface surface = surface_at(uintBitsToFloat(object_words(k, 0u).xyz), weights.y, d, away);
  CubePlace place = cube_place(turned(found == SKY ? d : surface.mirrored));
  vec3 mirrored = vec3(0.0);
  if (SHARP) {
    float lod = found == SKY ? lod_of(place.size) : lod_of(place.size * surface.size) + surface.spread;
    mirrored = chain_at(chain, p.chain_size, p.chain_last, place, max(0.0, lod));
  }
  vec3 reflected = weights.z * mirrored;
  if (ROUGH) {
    reflected += weights.w * cube_at(specular, diffuse_near.w, levels.x, place) +
                 uintBitsToFloat(f0_far.w) * cube_at(specular, levels.y, levels.z, place);
  }
  vec2 pair = brdf_at(k, surface.nov);
  vec3 lit = light_of_surface(reflected, irradiance(turned(surface.n)), uintBitsToFloat(f0_far.rgb),
                              uintBitsToFloat(diffuse_near.rgb), pair.x, pair.y);
  return found == SKY ? mirrored : lit;
}

// A ray of the grid in the pixel with its upper left corner at (x, y).
vec3 grid_ray(float x, float y, uint k, uint side) {
  float step_ = 1.0 / float(side);
  return ray(x + (float(k % side) + 0.5) * step_, y + (float(k / side) + 0.5) * step_);
}

u64vec2 float_words(vec3 c) { return pack64(floatBitsToUint(vec4(c, 1.0))); }

// Draws the pixel, unless it shows the sky alone.
void draw_object(uint column, uint row) {
  float x = float(column);
  float y = float(row);
  uint side = p.samples_side;
  float away;
  vec3 middle = ray(x + 0.5, y + 0.5);
  int centre = object_at(middle, away);
  vec3 c = light(middle, centre, away);
  bool mixed = false;
  if (SAMPLES) {
    uint k = 0u;
    do {
      float grid_away;
      mixed = mixed || object_at(grid_ray(x, y, k, side), grid_away) != centre;
    } while (++k < side * side);
    vec3 sum = vec3(0.0);
    for (k = 0u; k < (mixed ? side * side : 0u); ++k) {
      vec3 d = grid_ray(x, y, k, side);
      int found = object_at(d, away);
      sum += light(d, found, away);
    }
    if (mixed) c = sum / float(side * side);
  }
  if (column >= p.width || row >= p.height || (centre == SKY && !mixed)) return;
  uint at = (row - p.first_row) * p.pitch + column;
  if (FLOATS) {
    written[at] = float_words(clamp(c, -MAX_LIGHT, MAX_LIGHT));
  } else {
    written[at / 2u][at & 1u] = pack_halves(clamp(c, -MAX_HALF, MAX_HALF));
  }
}

// The sky along a row, from `x` to `x_end`, two pixels at a time. A mean of texels needs no clamp.
void draw_sky(uint x, uint x_end, uint y) {
  vec3 along = turned(vec3(p.pixel, 0.0, 0.0));
  vec3 middle = turned(ray(0.5 * float(p.width), float(y) + 0.5));
  float to_middle = 0.5 - 0.5 * float(p.width);
  uint start = (y - p.first_row) * p.pitch;
  do {
    uint64_t texels[2];
    [[unroll]] for (uint i = 0u; i < 2u; ++i) {
      CubePlace place = cube_place(middle + (float(x + i) + to_middle) * along);
      vec3 c;
      if (MAGNIFIED) {
        c = cube_at(chain, CUBE_LEVEL_START(p.chain_size, p.chain_size, 0u), p.chain_size, place);
      } else {
        c = chain_at(chain, p.chain_size, p.chain_last, place, max(0.0, lod_of(place.size)));
      }
      if (FLOATS) {
        if (x < x_end) written[start + x + i] = float_words(c);
      } else {
        texels[i] = pack_halves(c);
      }
    }
    if (!FLOATS && x < x_end) written[(start + x) / 2u] = u64vec2(texels[0], texels[1]);
    x += 2u * VIEW_TILE;
  } while (x < x_end);
}

void main() {
  p = pushed;
  uint x = gl_GlobalInvocationID.x;
  uint y = gl_GlobalInvocationID.y;
  if (OBJECTS) {
    draw_object(x, y);
  } else {
    uint first = gl_WorkGroupID.x * VIEW_SKY_X;
    uint end = y < p.height ? min(first + VIEW_SKY_X, p.pitch) : 0u;
    draw_sky(first + 2u * gl_LocalInvocationID.x, end, y);
  }
}
