// A folder with frames, and `candela stream` on it.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"
#include "tests/cli/command.h"
#include "tests/support/files.h"

namespace candela {

class StreamFixture : public ::testing::Test {
 protected:
  // Writes a sequence of `frames` frames into the folder "in".
  void make_frames(int frames, const std::string& size = "64x48") {
    ASSERT_EQ(
        candela({"sample", "--sequence", in(), "--frames", std::to_string(frames), "--size", size, "-q"})
            .code,
        0);
  }

  // Returns its lines: one for each frame, then the summary.
  std::vector<nlohmann::json> stream(std::vector<std::string> options, const std::string& out = "out") {
    options.insert(options.begin(), {"stream", in(), folder_.path(out), "-q", "--json", "-"});
    const Outcome outcome = candela(options);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    return lines_of(outcome.out);
  }

  static std::vector<nlohmann::json> lines_of(const std::string& text) {
    std::vector<nlohmann::json> lines;
    for (const absl::string_view line : absl::StrSplit(text, '\n', absl::SkipEmpty())) {
      lines.push_back(nlohmann::json::parse(line, nullptr, false));
      EXPECT_TRUE(lines.back().is_object()) << line;
    }
    return lines;
  }

  std::string image(const std::string& name, const std::string& out = "out") const {
    return read_file(folder_.path(out) + "/" + name);
  }

  std::string in() const { return folder_.path("in"); }

  const TemporaryFolder folder_;
};

}  // namespace candela
