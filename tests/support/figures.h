// Figures that tests measure, for docs/robustness.md.
#pragma once

#include "absl/strings/string_view.h"

namespace candela::testing {

// Appends a figure to the file that CANDELA_TEST_FIGURES names, unless the test has failed.
// tests/promises.toml has its name. `against` is the same of the control, or from before.
void record_figure(absl::string_view name, double value, absl::string_view unit, double against);

}  // namespace candela::testing
