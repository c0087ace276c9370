// Exponentials and logarithms with the same bits on every processor and with every C library, for exposures,
// which are part of resume tokens, and other results: those of the libraries differ in the last bit. Within
// 2^-80 of the exact value before they are rounded. About 0.5 us each. Any thread.
#pragma once

namespace candela {

// 2^x.
double portable_exp2(double x);
// e^x, and e^x - 1 with all its digits near 0.
double portable_exp(double x);
double portable_expm1(double x);
// x > 0.
double portable_log2(double x);
// x^y; 0 for x = 0.
double portable_power(double x, double y);

}  // namespace candela
