// The hard cases of docs/pipeline.md section 6 from file to file, in every tier.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/cli/command.h"
#include "tests/support/files.h"
#include "tests/support/scenes.h"

namespace candela {
namespace {

constexpr uint32_t kWidth = 67;
constexpr uint32_t kHeight = 35;

std::string pfm(const testing::HardCase& hard) {
  std::string bytes = "PF\n67 35\n-1.0\n";
  for (uint32_t y = kHeight; y-- > 0;) {
    for (uint32_t x = 0; x < kWidth; ++x) {
      const testing::Texel texel = hard.texel(x, y);
      bytes.append(reinterpret_cast<const char*>(texel.data()), 3 * sizeof(float));
    }
  }
  return bytes;
}

// The error of a picture with the tier `tier`, or with the promise `max_error` in its place.
double error_of(const std::string& in, const std::string& out, const std::string& option,
                const std::string& value, const std::string& bloom) {
  const nlohmann::json done =
      candela_json({"render", in, out, option, value, "--bloom-intensity", bloom, "--verify", "-q"});
  EXPECT_TRUE(done.is_object());
  if (!done.is_object()) return 255;
  if (option == "--tier") {
    EXPECT_EQ(done.at("tier"), value);
  }
  EXPECT_TRUE(std::isfinite(done.at("exposure").get<double>()));
  EXPECT_TRUE(done.at("verify").at("max_error_codes").is_number());
  return done.at("verify").at("max_error_codes").get<double>();
}

TEST(HardCases, BecomePicturesWithinThePublishedErrorInEveryTier) {
  const TemporaryFolder folder;
  const std::string out = folder.path("out.png");
  // Draft has no bound where something blooms. Without bloom it is within its transfer's error.
  struct Case {
    std::string tier, bloom;
    double codes;
  };
  const std::vector<Case> cases = {{"draft", "0.05", 255},
                                   {"draft", "0", 0.083 + 4e-4},
                                   {"standard", "0.05", 4e-4},
                                   {"standard", "0", 4e-4},
                                   {"reference", "0.05", 4e-4}};
  for (const testing::HardCase& hard : testing::hard_cases(kWidth, kHeight)) {
    const std::string in = folder.path("in.pfm");
    write_file(in, pfm(hard));
    for (const Case& c : cases) {
      SCOPED_TRACE(hard.name + " " + c.tier + " " + c.bloom);
      EXPECT_LE(error_of(in, out, "--tier", c.tier, c.bloom), c.codes);
    }
    SCOPED_TRACE(hard.name + " within 0.1");
    EXPECT_LE(error_of(in, out, "--max-error", "0.1", "0.05"), 0.1);
  }
}

// The number of the driver's threads does not change the picture.
TEST(HardCases, TheNumberOfThreadsChangesNoBit) {
  const TemporaryFolder folder;
  const std::string in = folder.path("in.exr");
  ASSERT_EQ(candela({"sample", in, "--size", "333x217", "-q"}).code, 0);
  std::string first;
  for (const char* threads : {"1", "2", "7"}) {
    setenv("LP_NUM_THREADS", threads, 1);
    const std::string out = folder.path("out.png");
    EXPECT_EQ(
        candela({"render", in, out, "-q", "--bits", "16", "--percentiles", "10,90", "--weights", "center"})
            .code,
        0);
    unsetenv("LP_NUM_THREADS");
    if (first.empty()) first = read_file(out);
    EXPECT_TRUE(read_file(out) == first) << threads << " threads";
  }
}

}  // namespace
}  // namespace candela
