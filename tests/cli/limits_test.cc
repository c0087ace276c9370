// The limits of the shell and odd files: one line, exit code 1, and nothing left behind.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"

namespace candela {
namespace {

class Limits : public ::testing::Test {
 protected:
  void SetUp() override { write_small_exr(in_); }

  void expect_failure(const Outcome& outcome, const std::string& words) const {
    EXPECT_EQ(outcome.code, 1) << outcome.err;
    EXPECT_EQ(outcome.err.find("candela: error: "), 0u) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_NE(outcome.err.find(words), std::string::npos) << outcome.err;
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string out_ = folder_.path("out.png");
};

TEST_F(Limits, AFileThatMayNotBecomeSoLargeIsAnErrorAndTheOldOneStays) {
  const std::string scene = folder_.path("scene.exr");
  ASSERT_EQ(candela({"sample", scene, "--size", "320x180", "-q"}).code, 0);
  for (const std::string& path : {out_, folder_.path("out.exr"), folder_.path("out.pfm")}) {
    write_file(path, "old");
    const std::vector<std::string> before = folder_.list();
    expect_failure(candela_with_ulimit("-f 8", {"sample", path.substr(0, path.size() - 4) + ".pfm"}),
                   "too large");
    expect_failure(candela_with_ulimit("-f 8", {"render", scene, path, "-q"}),
                   path + ": cannot write: File too large");
    EXPECT_EQ(read_file(path), "old");
    EXPECT_EQ(folder_.list(), before);
  }
}

#ifndef CANDELA_SANITIZED  // a sanitizer reserves terabytes of addresses
TEST_F(Limits, TooLittleAddressSpaceIsSaidBeforeTheWork) {
  for (const char* mib : {"300", "500", "700", "900", "1100", "1300"}) {
    SCOPED_TRACE(mib);
    const std::string limit = std::string("-v $((") + mib + " * 1024))";
    expect_failure(candela_with_ulimit(limit, {"render", in_, out_, "-q"}),
                   "ulimit -v allows " + std::string(mib));
    expect_failure(candela_with_ulimit(limit, {"stream", in_, folder_.path("out"), "-q"}),
                   "the built-in server needs");
    EXPECT_EQ(candela_with_ulimit(limit, {"info", in_}).code, 0);
  }
  // The folder for the images is made before the server starts.
  EXPECT_EQ(folder_.list(), (std::vector<std::string>{"in.exr", "out"}));
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path("out")));
}
#endif

TEST_F(Limits, APipeInPlaceOfAFileIsNotWaitedFor) {
  const std::string pipe = folder_.path("pipe");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const std::string folder = folder_.path("out"), nowhere = "127.0.0.1:1";
  const std::string no_file = "not a regular file";
  expect_failure(candela({"stream", in_, folder, "-q", "--exposures", pipe}), no_file);
  expect_failure(candela({"stream", in_, folder, "-q", "--state", pipe}), no_file);
  expect_failure(candela({"render", in_, out_, "-q", "--locked-exposure", pipe}), no_file);
  expect_failure(candela({"render", in_, out_, "-q", "--ocio", pipe}), no_file);
  for (const char* option : {"--token-file", "--tls-ca"}) {
    const Outcome outcome = candela({"render", in_, out_, "-q", "--server", nowhere, option, pipe});
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_NE(outcome.err.find(no_file), std::string::npos) << outcome.err;
  }
}

TEST_F(Limits, AKeyThatAnExposureFileHoldsTwiceIsRefused) {
  const std::string shot = folder_.path("shot.json");
  ASSERT_EQ(candela({"meter", in_, "-q", "--save-exposures", shot}).code, 0);
  std::string text = read_file(shot);
  const size_t at = text.find("\"locked\"");
  ASSERT_NE(at, std::string::npos);
  text.insert(at, "\"locked\": 1e-3,\n ");
  write_file(shot, text);
  expect_failure(candela({"render", in_, out_, "-q", "--locked-exposure", shot}),
                 "\"locked\" is there twice");
}

}  // namespace
}  // namespace candela
