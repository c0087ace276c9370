// Powers with the same bits on every processor, for the curves of signals: those of C libraries differ in the
// last bit. Made of additions, multiplications and divisions alone. About as fast. Any thread.
#pragma once

namespace candela {

// log2 of a finite x > 0, to 1e-15 of the result or of 1, whichever is larger.
double log2_of(double x);

// e^x, to 1e-14 of it within -700 .. 700. 0 below -760, infinite above 760; NaN stays NaN.
double exponential(double x);

// x^y to 1e-12 of it for x >= 0 and a finite y > 0, while it is a normal number. 0, infinity and NaN stay
// what they are.
double power(double x, double y);

}  // namespace candela
