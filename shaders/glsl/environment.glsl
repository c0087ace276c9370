// Directions, panoramas and cube maps of environments (docs/environments.md sections 1 and 2).
#include "environment/environment_params.h"
#include "cube.glsl"

// atan(t) / t in turns, for s = t^2. Errors are in radians.
// fit: s in [0, 1], degree 8, error 4.0e-08, best 1.4e-08
float turns_of_tangent(float s) {
  float q = 0.000462117634 * s - 0.00259153289;
  q = q * s + 0.00684994692;
  q = q * s - 0.0119902333;
  q = q * s + 0.0169574525;
  q = q * s - 0.0226113573;
  q = q * s + 0.0318199359;
  q = q * s - 0.0530512668;
  q = q * s + 0.159154937;
  return q;
}

// The smaller angle of the right triangle with the legs a, b >= 0, in turns: 0 .. 1/8. 0 if both are 0.
float small_angle(float a, float b) {
  float large = max(a, b);
  float t = large > 0.0 ? min(a, b) / large : 0.0;
  return t * turns_of_tangent(t * t);
}

// --- panoramas

// A place between texels: the one at its upper left, which may be one row above the panorama, and the
// weights of the next column and row.
struct PanoramaPlace {
  int x, y;
  float fx, fy;
};

// Where a panorama shows the direction d. The large part of each coordinate is a multiple of 1/4 and exact,
// so that wide panoramas do not lose bits.
PanoramaPlace panorama_place(PanoramaLayout panorama, vec3 d) {
  PanoramaPlace place;
  float w = float(panorama.width);
  bool side = abs(d.x) > abs(d.z);
  bool behind = d.z > 0.0;
  float right = d.x < 0.0 ? -1.0 : 1.0;
  float quarters = side ? 0.25 : behind ? 0.5 : 0.0;
  float offset = small_angle(abs(d.x), abs(d.z)) * (side == behind ? right : -right);
  float large = right * quarters * w + (0.5 * w - 0.5) + float(panorama.turn);
  float whole = floor(large);
  float rest = offset * w + (large - whole) + panorama.turn_fraction;
  float column = floor(rest);
  place.fx = rest - column;
  place.x = int(whole + column);
  place.x += place.x < 0 ? int(panorama.width) : 0;
  place.x -= place.x >= int(panorama.width) ? int(panorama.width) : 0;

  float h = float(panorama.height);
  float level = sqrt(d.x * d.x + d.z * d.z);
  bool steep = abs(d.y) > level;
  bool up = d.y > 0.0;
  float down = small_angle(abs(d.y), level) * (steep == up ? 2.0 : -2.0);
  large = (steep ? (up ? 0.0 : h) : 0.5 * h) - 0.5;
  whole = floor(large);
  rest = down * h + (large - whole);
  float row = floor(rest);
  place.fy = rest - row;
  place.y = clamp(int(whole + row), -1, int(panorama.height) - 1);
  return place;
}

vec3 panorama_texel(utextureBuffer texels, bool floats, uint at) {
  if (floats) return uintBitsToFloat(texelFetch(texels, int(at)).rgb);
  uvec4 words = texelFetch(texels, int(at / 2u));
  uvec2 halves = (at & 1u) == 0u ? words.xy : words.zw;
  return vec3(unpackHalf2x16(halves.x), unpackHalf2x16(halves.y).x);
}

// Row y at the place's column. Beyond the first and the last row it is that row, half a turn further.
vec3 panorama_row(utextureBuffer texels, bool floats, PanoramaLayout panorama, PanoramaPlace place, int y) {
  int x = place.x;
  float f = place.fx;
  bool beyond = y < 0 || y >= int(panorama.height);
  float across = place.fx + ((panorama.width & 1u) != 0u ? 0.5 : 0.0);
  int carry = across >= 1.0 ? 1 : 0;
  int x_across = place.x + int(panorama.width / 2u) + carry;
  x_across -= x_across >= int(panorama.width) ? int(panorama.width) : 0;
  x = beyond ? x_across : x;
  f = beyond ? across - float(carry) : f;
  uint row = uint(clamp(y, 0, int(panorama.height) - 1)) * panorama.pitch;
  uint next = uint(x) + 1u == panorama.width ? 0u : uint(x) + 1u;
  return mix(panorama_texel(texels, floats, row + uint(x)), panorama_texel(texels, floats, row + next), f);
}

// P(d). The length of d does not matter. `floats`: the texels are not halves.
vec3 panorama_at(utextureBuffer texels, bool floats, PanoramaLayout panorama, vec3 d) {
  PanoramaPlace place = panorama_place(panorama, d);
  vec3 above = panorama_row(texels, floats, panorama, place, place.y);
  vec3 below = panorama_row(texels, floats, panorama, place, place.y + 1);
  return mix(above, below, place.fy);
}

// --- cube maps

// The direction, not of length 1, at (s, t) of a face: the table of section 2.
vec3 face_direction(uint face, float s, float t) {
  bool along_x = face < 2u;
  bool along_y = face == 2u || face == 3u;
  vec3 d = along_x ? vec3(1.0, -t, -s) : along_y ? vec3(s, 1.0, t) : vec3(s, -t, 1.0);
  vec3 opposite = along_y ? vec3(1.0, -1.0, -1.0) : vec3(-1.0, 1.0, -1.0);
  return (face & 1u) == 0u ? d : d * opposite;
}

vec3 cube_texel(utextureBuffer levels, uint at) { return uintBitsToFloat(texelFetch(levels, int(at)).rgb); }

// A level that begins at texel `start`, bilinear.
vec3 cube_at(utextureBuffer levels, uint start, uint size, CubePlace place) {
  CubeSpot spot = cube_spot(start, size, place);
  uint below_at = spot.at + (size + 2u);
  vec3 above = mix(cube_texel(levels, spot.at), cube_texel(levels, spot.at + 1u), spot.across);
  vec3 below = mix(cube_texel(levels, below_at), cube_texel(levels, below_at + 1u), spot.across);
  return mix(above, below, spot.down);
}

// A chain of levels, bilinear in each and linear between two. `last` is the level of 1 x 1.
vec3 chain_at(utextureBuffer chain, uint size, uint last, CubePlace place, float lod) {
  float level = clamp(lod, 0.0, float(last));
  uint fine = uint(level);
  uint coarse = min(fine + 1u, last);
  uint fine_size = size >> fine;
  uint coarse_size = size >> coarse;
  vec3 a = cube_at(chain, CUBE_LEVEL_START(size, fine_size, fine), fine_size, place);
  vec3 b = cube_at(chain, CUBE_LEVEL_START(size, coarse_size, coarse), coarse_size, place);
  return mix(a, b, level - float(fine));
}

// --- levels with their borders, as the passes write them

// A texel of a face. Beyond the face, i or j is -1 or the size.
struct CubeTexel {
  uint face;
  int i, j;
};

// Invocation `at` of a level.
CubeTexel bordered_texel(uint at, uint size) {
  uint pitch = size + 2u;
  uint line = at / pitch;
  return CubeTexel(line / pitch, int(at % pitch) - 1, int(line % pitch) - 1);
}

bool outside(int i, uint size) { return i < 0 || i >= int(size); }

// The number of texels whose mean a bordered texel is.
uint sources(CubeTexel texel, uint size) {
  return outside(texel.i, size) && outside(texel.j, size) ? 3u : 1u;
}

// Source k of a bordered texel: a texel inside a face. One beyond an edge is found with the direction of the
// edge's own point. Its old axis is made a little shorter, so that the other face has it.
CubeTexel source(CubeTexel texel, uint k, uint size) {
  int end = int(size) - 1;
  if (sources(texel, size) == 3u) {
    if (k != 1u) texel.i = clamp(texel.i, 0, end);
    if (k != 2u) texel.j = clamp(texel.j, 0, end);
  }
  bool beyond_i = outside(texel.i, size);
  if (!beyond_i && !outside(texel.j, size)) return texel;
  const float shorter = 0.99993896484375;  // 1 - 2^-14
  float along = float(2 * (beyond_i ? texel.j : texel.i) + 1 - int(size)) / float(size);
  float s = beyond_i ? (texel.i < 0 ? -1.0 : 1.0) : along;
  float t = beyond_i ? along : (texel.j < 0 ? -1.0 : 1.0);
  vec3 d = face_direction(texel.face, s, t);
  uint axis = texel.face / 2u;
  d *= vec3(axis == 0u ? shorter : 1.0, axis == 1u ? shorter : 1.0, axis == 2u ? shorter : 1.0);
  CubePlace place = cube_place(d);
  int i = int((place.s + 1.0) * 0.5 * float(size));
  int j = int((place.t + 1.0) * 0.5 * float(size));
  return CubeTexel(place.face, clamp(i, 0, end), clamp(j, 0, end));
}

// The unit direction of a texel's centre.
vec3 texel_direction(CubeTexel texel, uint size) {
  float scale = 1.0 / float(size);
  return normalize(face_direction(texel.face, float(2 * texel.i + 1 - int(size)) * scale,
                                  float(2 * texel.j + 1 - int(size)) * scale));
}
