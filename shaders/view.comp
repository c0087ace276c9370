// A view of an environment: the sky, and spheres in front of it.
//
// In: the chain, the specular levels, and the scene: a ViewLight and ViewObjects. Out: rows of RGBA halves,
// as they would arrive on the wire.
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

uvec4 object_words(int k, uint i) {
  return texelFetch(scene, int(VIEW_LIGHT_TEXELS + uint(k) * VIEW_OBJECT_TEXELS + i));
}

// The object that the ray meets first, or SKY, and how many times d it is away. Which objects are met
// follows from multiplications and additions alone.
int object_at(vec3 d, out float nearest) {
  int found = SKY;
  nearest = uintBitsToFloat(0x7f800000u);
  float length2 = squared(d);
  int k = int(p.first_object);
  do {
    vec4 sphere = uintBitsToFloat(object_words(k, 0u));
    float to_surface = uintBitsToFloat(object_words(k, 1u).x);
    vec3 o = sphere.xyz;
    precise float along = (o.x * d.x + o.y * d.y) + o.z * d.z;
    precise vec3 across = vec3(o.y * d.z - o.z * d.y, o.z * d.x - o.x * d.z, o.x * d.y - o.y * d.x);
    precise float limit = sphere.w * length2;
    precise float room = limit - squared(across);
    bool hit = along < 0.0 && squared(across) <= limit;
    float away = to_surface / (sqrt(max(room, 0.0)) - along);
    if (hit && away < nearest) {
      nearest = away;
      found = k;
    }
  } while (++k < int(p.end_object));
  return found;
}

// (scale, bias) of object k, linear in n.v. Its roughness is constant, so the host interpolates along it.
vec2 brdf_at(int k, float nov) {
  const float end = float(BRDF_SIZE) - 1.0;
  float x = clamp(nov * float(BRDF_SIZE) - 0.5, 0.0, end);
  float left = floor(x);
  vec4 pairs = uintBitsToFloat(object_words(k, 5u + uint(left)));
  return mix(pairs.xy, pairs.zw, x - left);
}

// Irr(n), for a unit direction in the environment's axes.
vec3 irradiance(vec3 n) {
  float factors[9] = {1.0, n.y, n.z, n.x, n.x * n.y, n.y * n.z, 3.0 * n.z * n.z - 1.0, n.x * n.z,
                      n.x * n.x - n.y * n.y};
  vec3 sum = vec3(0.0);
  [[unroll]] for (int i = 0; i < 9; ++i) sum += factors[i] * uintBitsToFloat(texelFetch(scene, i).rgb);
  return max(sum, vec3(0.0));
}

// Half the log2 of a ray's solid angle over a texel's of level 0. `size` is the largest component of the
// direction that is looked up, and the ray's own length if that direction has length 1.
float lod_of(float size) { return p.lod - 1.5 * log2(size); }

// What is seen along a ray that meets object `found` at `away` times d, or the sky.
vec3 light(vec3 d, int found, float away) {
  if (found == SKY) away = 1.0;  // only so that what follows stays finite
  int k = max(found, 0);
  vec4 surface = uintBitsToFloat(object_words(k, 1u));  // to_surface, inverse_radius, chain and near weight
  uvec4 f0_far = object_words(k, 2u);
  uvec4 diffuse_near = object_words(k, 3u);
  uvec4 levels = object_words(k, 4u);
  float length_d = sqrt(squared(d));
  vec3 toward = d / length_d;
  vec3 n = normalize(uintBitsToFloat(object_words(k, 0u).xyz) + away * d);
  float nov = clamp(-dot(n, toward), 0.0, 1.0);
  CubePlace place = cube_place(turned(found == SKY ? d : reflect(toward, n)));
  vec3 mirrored = vec3(0.0);
  if (SHARP) {
    float q = max(nov, 0.001);
    float bend = 2.0 * away * length_d * surface.y;
    float spread = 0.5 * log2((1.0 + bend * q) * (1.0 + bend / q));
    float lod = found == SKY ? lod_of(place.size) : lod_of(place.size * length_d) + spread;
    mirrored = chain_at(chain, p.chain_size, p.chain_last, place, max(0.0, lod));
  }
  vec3 reflected = surface.z * mirrored;
  if (ROUGH) {
    reflected += surface.w * cube_at(specular, diffuse_near.w, levels.x, place) +
                 uintBitsToFloat(f0_far.w) * cube_at(specular, levels.y, levels.z, place);
  }
  vec2 pair = brdf_at(k, nov);
  vec3 f = uintBitsToFloat(f0_far.rgb) * pair.x + pair.y;
  vec3 diffuse = uintBitsToFloat(diffuse_near.rgb) * irradiance(turned(n)) * (1.0 - f);
  return found == SKY ? mirrored : reflected * f + diffuse;
}

// A ray of the grid in the pixel with its upper left corner at (x, y).
vec3 grid_ray(float x, float y, uint k, uint side) {
  float step_ = 1.0 / float(side);
  return ray(x + (float(k % side) + 0.5) * step_, y + (float(k / side) + 0.5) * step_);
}

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
  written[at / 2u][at & 1u] = pack_halves(clamp(c, -MAX_SCENE_VALUE, MAX_SCENE_VALUE));
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
      texels[i] = pack_halves(c);
    }
    if (x < x_end) written[(start + x) / 2u] = u64vec2(texels[0], texels[1]);
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
