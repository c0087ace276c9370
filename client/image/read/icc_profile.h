// What the ICC profile of a file makes of its codes. Internal to client/image.
#pragma once

#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "client/image/read/signal.h"

namespace candela {

// Sets what the profile says of a picture of this many components: 1 of grey, 3 of R, G and B, 4 of C, M, Y
// and K. `source` is what the file calls it, such as "iCCP". If it cannot be used, `signal` stays as it is
// and `notes` say why. Hostile profiles take 32 MiB at most, and the time of a damaged one.
void take_profile(const char* source, absl::string_view icc, int components, Signal& signal,
                  std::vector<std::string>& notes);

}  // namespace candela
