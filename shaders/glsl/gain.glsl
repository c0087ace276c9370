// The code, 0 .. 1, of a gain map beside an SDR image (docs/pipeline.md section 5).
//
// The including shader declares gain_points, cubic pieces that server/render/color/hdr_signal.h makes. This file is
// C++, too: server/render/host/lanes-inl.h says what that asks for.

float gain_code(vec3 exposed) {
  float n = at_most(at_least(max(max(exposed.r, exposed.g), exposed.b), 0.0), GAIN_END);
  uint bits = floatBitsToUint(n + GAIN_KNEE);
  uint piece = (bits >> GAIN_SHIFT) - (floatBitsToUint(GAIN_KNEE) >> GAIN_SHIFT);
  uint rest = bits & ((1u << GAIN_SHIFT) - 1u);
  float t = float(int(rest)) * (1.0 / float(1 << GAIN_SHIFT));
  uvec4 element = texelFetch(gain_points, int(min(piece, GAIN_PIECES - 1u)));
  vec3 c = uintBitsToFloat(element.rgb);
  return at_most(at_least(((uintBitsToFloat(element.a) * t + c.b) * t + c.g) * t + c.r, 0.0), 1.0);
}
