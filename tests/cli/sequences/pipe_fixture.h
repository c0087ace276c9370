// Frames through pipes: fed to candela, and read as a reader of PAM or y4m sees them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "tests/cli/command.h"
#include "tests/cli/sequences/stream_fixture.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {

// A frame of a PAM or of a y4m, as a reader of these formats sees it.
struct PipedFrame {
  uint32_t width = 0, height = 0;
  int bits = 8, depth = 3;
  std::vector<int> codes;  // of y4m: of its planes
};

inline int code_at(const std::string& bytes, size_t at, bool wide, bool big_endian) {
  const auto byte = [&](size_t i) { return static_cast<int>(static_cast<unsigned char>(bytes.at(i))); };
  if (!wide) return byte(at);
  return big_endian ? byte(at) << 8 | byte(at + 1) : byte(at + 1) << 8 | byte(at);
}

inline std::vector<PipedFrame> pam_frames(const std::string& bytes) {
  std::vector<PipedFrame> frames;
  for (size_t at = 0; at < bytes.size();) {
    const size_t end = bytes.find("ENDHDR\n", at);
    if (bytes.substr(at, 3) != "P7\n" || end == std::string::npos) {
      ADD_FAILURE() << "no PAM at " << at;
      break;
    }
    PipedFrame frame;
    for (const absl::string_view line : absl::StrSplit(bytes.substr(at, end - at), '\n')) {
      const std::pair<std::string, std::string> words = absl::StrSplit(line, ' ');
      if (words.first == "WIDTH") {
        EXPECT_TRUE(absl::SimpleAtoi(words.second, &frame.width));
      }
      if (words.first == "HEIGHT") {
        EXPECT_TRUE(absl::SimpleAtoi(words.second, &frame.height));
      }
      if (words.first == "DEPTH") {
        EXPECT_TRUE(absl::SimpleAtoi(words.second, &frame.depth));
      }
      if (words.first == "MAXVAL") frame.bits = words.second == "65535" ? 16 : 8;
    }
    at = end + 7;
    const size_t size = frame.bits / 8;
    for (size_t i = 0; i < size_t{frame.width} * frame.height * frame.depth; ++i, at += size) {
      frame.codes.push_back(code_at(bytes, at, size == 2, true));
    }
    frames.push_back(frame);
  }
  return frames;
}

inline std::vector<PipedFrame> y4m_frames(const std::string& bytes, std::string& header) {
  size_t at = bytes.find('\n') + 1;
  header = bytes.substr(0, at);
  PipedFrame frame;
  bool halved = false;
  for (const absl::string_view word : absl::StrSplit(header.substr(0, at - 1), ' ')) {
    if (word[0] == 'W') {
      EXPECT_TRUE(absl::SimpleAtoi(word.substr(1), &frame.width));
    }
    if (word[0] == 'H') {
      EXPECT_TRUE(absl::SimpleAtoi(word.substr(1), &frame.height));
    }
    if (word[0] == 'C') halved = word.substr(1, 3) == "420";
    if (word[0] == 'C' && absl::EndsWith(word, "p10")) frame.bits = 10;
  }
  const size_t step = halved ? 2 : 1, size = frame.bits > 8 ? 2 : 1;
  const size_t samples = size_t{frame.width} * frame.height +
                         2 * ((frame.width + step - 1) / step) * ((frame.height + step - 1) / step);
  std::vector<PipedFrame> frames;
  while (at < bytes.size()) {
    EXPECT_EQ(bytes.substr(at, 6), "FRAME\n");
    at += 6;
    frames.push_back(frame);
    for (size_t i = 0; i < samples; ++i, at += size) {
      frames.back().codes.push_back(code_at(bytes, at, size == 2, false));
    }
  }
  EXPECT_EQ(at, bytes.size()) << "the last frame is not whole";
  return frames;
}

class Pipes : public StreamFixture {
 protected:
  // The frames of "in", one after another, in a file.
  std::string all_frames() {
    std::string all;
    for (const std::string& name : names_in(in())) all += read_file(in() + "/" + name);
    write_file(folder_.path("all"), all);
    return folder_.path("all");
  }
  // With this file as standard input, through a pipe.
  Outcome fed(const std::string& file, const std::vector<std::string>& arguments) {
    const std::string fifo = folder_.path(absl::StrFormat("fifo%d", fifos_++));
    return candela_in_shell("mkfifo " + fifo + " && { cat " + file + " > " + fifo + " & } && exec < " + fifo,
                            arguments);
  }
  void expect_line(const Outcome& outcome, int code, const std::string& words) {
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  }

  int fifos_ = 0;
};

}  // namespace candela
