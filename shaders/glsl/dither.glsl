// Dither (docs/pipeline.md section 5). This file is C++, too: server/render/host/lanes-inl.h says what that
// asks for.

// Triangular noise in (-1, 1) with mean zero, from the integer hash pcg3d. Source: M. Jarzynski and M. Olano,
// "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
vec3 dither_noise(uint x, uint y, uint frame) {
  uvec3 v = uvec3(x, y, frame) * 1664525u + 1013904223u;
  v.r += v.g * v.b;
  v.g += v.b * v.r;
  v.b += v.r * v.g;
  v ^= v >> 16;
  v.r += v.g * v.b;
  v.g += v.b * v.r;
  v.b += v.r * v.g;
  return (vec3(v & 0xffffu) - vec3(v >> 16)) * (1.0 / 65536.0);
}
