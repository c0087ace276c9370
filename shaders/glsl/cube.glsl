// Where a direction is in the levels of a cube map (docs/environments.md section 2). This file is C++, too:
// server/render/host/lanes-inl.h says what that asks for.
//
// A level is stored with a border around each face (CUBE_LEVEL_START in environment_params.h), so a bilinear
// look-up reads four texels of one face and is seamless.

// Where a direction meets the cube. `size` is the direction's largest component's.
struct CubePlace {
  uint face;
  float s;
  float t;
  float size;
};

// Signs are turned and magnitudes are compared as integers, and there is one division, because that takes
// fewer instructions than floats and two divisions.
CubePlace cube_place(vec3 d) {
  const uint minus = 0x80000000u;
  uvec3 bits = floatBitsToUint(d);
  uvec3 a = bits & 0x7fffffffu;
  uint largest = max(max(a.r, a.g), a.b);
  bool along_x = a.r == largest;
  bool along_y = a.g == largest;  // counts only where along_x is false
  uint side = mix(mix(bits.b, bits.g, along_y), bits.r, along_x) & minus;
  uint s = mix(bits.r ^ mix(side, 0u, along_y), bits.b ^ side ^ minus, along_x);
  uint t = mix(mix(bits.g ^ minus, bits.b ^ side, along_y), bits.g ^ minus, along_x);
  CubePlace place;
  place.size = uintBitsToFloat(largest);
  place.face = mix(mix(uint(4u), 2u, along_y), 0u, along_x) + (side >> 31);
  float inverse = 1.0 / place.size;
  place.s = uintBitsToFloat(s) * inverse;
  place.t = uintBitsToFloat(t) * inverse;
  return place;
}

// The four texels of a bilinear look-up: `at`, the next one, and those `size` + 2 further. The weights are those
// of the next column and of the next row.
struct CubeSpot {
  uint at;
  float across;
  float down;
};

// In a level that begins at texel `start`.
CubeSpot cube_spot(uint start, uint size, CubePlace place) {
  float scale = 0.5 * float(size);
  float middle = floor(scale + 0.5);  // between or at texels of the bordered face, and the rest
  float rest = scale + 0.5 - middle;
  float x = place.s * scale + rest;
  float y = place.t * scale + rest;
  float column = floor(x);
  float row = floor(y);
  uint pitch = size + 2u;
  // Roundings do not reach beyond the border, so nothing is clamped.
  uint origin = start + uint(int(middle)) * (pitch + 1u);
  CubeSpot spot;
  spot.at = origin + place.face * (pitch * pitch) + uint(int(row)) * pitch + uint(int(column));
  spot.across = x - column;
  spot.down = y - row;
  return spot;
}
