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

TEST(HardCases, BecomePicturesWithAStatedErrorInEveryTier) {
  const TemporaryFolder folder;
  for (const testing::HardCase& hard : testing::hard_cases(kWidth, kHeight)) {
    const std::string in = folder.path("in.pfm");
    write_file(in, pfm(hard));
    for (const char* tier : {"draft", "standard", "reference"}) {
      const nlohmann::json done =
          candela_json({"render", in, folder.path("out.png"), "--tier", tier, "--verify", "-q"});
      ASSERT_TRUE(done.is_object()) << hard.name;
      EXPECT_EQ(done.at("tier"), tier) << hard.name;
      ASSERT_TRUE(done.at("verify").at("max_error_codes").is_number()) << hard.name << " " << tier;
      EXPECT_LE(done.at("verify").at("max_error_codes").get<double>(),
                tier == std::string("draft") ? 255.0 : 4e-4)
          << hard.name << " " << tier;
      EXPECT_TRUE(std::isfinite(done.at("exposure").get<double>())) << hard.name;
    }
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
