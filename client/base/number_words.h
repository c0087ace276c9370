// Numbers in sentences for people: without exponents and without a minus before zero.
#pragma once

#include <string>

namespace candela {

// With so many significant digits, and with all digits before the point: "0.0851", "12.3", "1638400". Only
// below 1e-9 and from 1e16 on there is an exponent.
std::string in_digits(double value, int digits);

// With so many decimals: "0.00", "-1.25".
std::string in_decimals(double value, int decimals);

// The same with its sign: "+0.00", "-1.25".
std::string with_sign(double value, int decimals);

}  // namespace candela
