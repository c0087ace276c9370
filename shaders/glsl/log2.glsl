// Logarithm and exponential of base 2, and powers. A driver's own pow() may be too inaccurate for an 8-bit code. This file is
// C++, too: server/render/host/lanes-inl.h says what that asks for.
//
// Each polynomial states its fit: interval, degree, largest error of the coefficients as they stand here, and
// the smallest error that any polynomial of this degree can have. shaders/fit/polynomials.py recomputes all
// four, and a test runs it. Rounding in the evaluation comes on top.

// log2 of a normal float: the exponent plus a polynomial for log2(1 + t) of the mantissa.
// fit: t in [0, 1], degree 7, error 2.8e-07, best 2.8e-07
float exact_log2(float x) {
  uint bits = floatBitsToUint(x);
  float t = uintBitsToFloat((bits & 0x007fffffu) | 0x3f800000u) - 1.0;
  float q = -0.0780621469 + 0.015125365 * t;
  q = q * t + 0.192089558;
  q = q * t - 0.324253947;
  q = q * t + 0.472897917;
  q = q * t - 0.720453024;
  q = q * t + 1.44265628;
  q = q * t + 2.77289104e-07;
  return float(int(bits >> 23) - 127) + q;
}

// 2^e for -126 <= e < 128: the whole part as an exponent, times a polynomial for 2^f of the fraction.
// fit: f in [0, 1], degree 5, error 1.2e-07, best 1.1e-07
float exact_exp2(float e) {
  float whole = floor(e);
  float f = e - whole;
  float r = 0.00894282945 + 0.00189646112 * f;
  r = r * f + 0.0558662452;
  r = r * f + 0.240139708;
  r = r * f + 0.693154752;
  r = r * f + 0.999999881;
  return r * uintBitsToFloat(uint(int(whole) + 127) << 23);
}

// x^e for x >= 0 and e > 0. Returns 0 for x below 1e-30.
float power(float x, float e) { return mix(exact_exp2(exact_log2(x) * e), 0.0, x < 1e-30); }
