// Words for numbers that are upper bounds.
#pragma once

#include <string>

namespace candela {

// Three significant digits of `bound`, which is finite and not negative, rounded up: what is within the bound
// is within the number in the text. 0.02731 is "0.0274".
std::string rounded_up(double bound);

}  // namespace candela
