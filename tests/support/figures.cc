#include "tests/support/figures.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "absl/strings/str_format.h"

namespace candela::testing {

void record_figure(absl::string_view name, double value, absl::string_view unit, double against) {
  const char* path = std::getenv("CANDELA_TEST_FIGURES");
  if (path == nullptr || ::testing::Test::HasFailure()) return;
  std::ofstream(path, std::ios::app) << absl::StrFormat(
      "{\"figure\": \"%s\", \"value\": %.1f, \"unit\": \"%s\", \"against\": %.1f}\n", name, value, unit,
      against);
}

}  // namespace candela::testing
