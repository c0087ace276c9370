// Frames through pipes: fed to candela, and read as a reader of PAM or y4m sees them.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/cli/stream_fixture.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

// A frame of a PAM or of a y4m, as a reader of these formats sees it.
struct PipedFrame {
  uint32_t width = 0, height = 0;
  int bits = 8, depth = 3;
  std::vector<int> codes;  // of y4m: of its planes
};

int code_at(const std::string& bytes, size_t at, bool wide, bool big_endian) {
  const auto byte = [&](size_t i) { return static_cast<int>(static_cast<unsigned char>(bytes.at(i))); };
  if (!wide) return byte(at);
  return big_endian ? byte(at) << 8 | byte(at + 1) : byte(at + 1) << 8 | byte(at);
}

std::vector<PipedFrame> pam_frames(const std::string& bytes) {
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

std::vector<PipedFrame> y4m_frames(const std::string& bytes, std::string& header) {
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

// `candela stream` and `candela render` with standard input and standard output.

using Json = nlohmann::json;

TEST_F(Pipes, FramesFromAPipeAreThoseOfFiles) {
  make_frames(6);
  const std::vector<std::string> session = {"--fps", "10", "--lookahead", "2", "--cut-at", "4", "--dither"};
  std::vector<std::string> of_files = session;
  of_files[5] = "3";  // the files are numbered from 0
  const std::vector<Json> files = stream(of_files);
  const Outcome piped = fed(
      all_frames(),
      with({"stream", "-", folder_.path("piped/%04d.png"), "-q", "--json", "-", "--first", "0"}, session));
  ASSERT_EQ(piped.code, 0) << piped.err;
  const std::vector<Json> lines = lines_of(piped.out);
  ASSERT_EQ(lines.size(), 7u);
  for (size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(lines[i].at("frame"), i + 1);
    EXPECT_EQ(lines[i].at("input"), absl::StrFormat("standard input, frame %d", i + 1));
    for (const char* key : {"exposure", "exposure_before", "target", "media_time_ns", "cut", "primaries"}) {
      EXPECT_EQ(lines[i].at(key), files[i].at(key)) << key << i;
    }
    const std::string name = absl::StrFormat("%04d.png", i);
    EXPECT_EQ(image(name, "piped"), image(name)) << name;
  }
  EXPECT_EQ(lines[6].at("summary").at("frames"), 6);
  EXPECT_EQ(lines[6].at("summary").at("last"), 6);
  // A folder's images have the frames' numbers.
  EXPECT_EQ(fed(all_frames(), with({"stream", "-", folder_.path("folder"), "-q"}, session)).code, 0);
  EXPECT_EQ(image("0006.png", "folder"), image("0005.png"));
}

TEST_F(Pipes, ExposuresOfAPipeAreSavedAndContinued) {
  make_frames(4);
  stream({"--save-exposures", folder_.path("files.json")});
  const std::string all = all_frames(), saved = folder_.path("piped.json");
  ASSERT_EQ(fed(all, {"stream", "-", "-", "--pipe", "pam", "-q", "--save-exposures", saved}).code, 0);
  const Json files = Json::parse(read_file(folder_.path("files.json"))),
             piped = Json::parse(read_file(saved));
  ASSERT_EQ(piped.at("frames").size(), 4u);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(piped.at("frames")[i].at("exposure"), files.at("frames")[i].at("exposure"));
    EXPECT_EQ(piped.at("frames")[i].at("frame"), i + 1);
  }
  const Outcome more = fed(all, {"stream", "-", folder_.path("more"), "-q", "--state", saved, "--json", "-"});
  ASSERT_EQ(more.code, 0) << more.err;
  EXPECT_EQ(lines_of(more.out)[0].at("frame"), 5);
  EXPECT_EQ(lines_of(more.out)[0].at("exposure_before"), piped.at("frames")[3].at("exposure"));
}

TEST_F(Pipes, APamHasTheCodesOfThePngs) {
  make_frames(3, "33x17");
  for (const char* bits : {"8", "16"}) {
    stream({"--bits", bits}, bits);
    const Outcome piped = candela({"stream", in(), "-", "--pipe", "pam", "--bits", bits, "-q"});
    ASSERT_EQ(piped.code, 0) << piped.err;
    const std::vector<PipedFrame> frames = pam_frames(piped.out);
    ASSERT_EQ(frames.size(), 3u);
    for (int i = 0; i < 3; ++i) {
      const Png png = read_png(folder_.path(bits) + absl::StrFormat("/%04d.png", i));
      ASSERT_EQ(frames[i].codes.size(), size_t{33 * 17 * 3});
      for (uint32_t at = 0; at < 33 * 17 * 3; ++at) {
        ASSERT_EQ(frames[i].codes[at], png.code(at / 3 % 33, at / 99, static_cast<int>(at % 3))) << bits << i;
      }
    }
  }
}

TEST_F(Pipes, AVideoIsThePicturesOf16BitsInYcbcr) {
  make_frames(3, "33x17");
  const Outcome exact = candela({"stream", in(), "-", "--pipe", "pam", "--bits", "16", "-q"});
  const std::vector<PipedFrame> pictures = pam_frames(exact.out);
  ASSERT_EQ(pictures.size(), 3u);
  for (const char* bits : {"8", "10"}) {
    const Outcome video =
        candela({"stream", in(), "-", "--pipe", "y4m444", "--bits", bits, "--fps", "24000/1001", "-q"});
    ASSERT_EQ(video.code, 0) << video.err;
    EXPECT_EQ(video.err, "");
    std::string header;
    const std::vector<PipedFrame> frames = y4m_frames(video.out, header);
    EXPECT_TRUE(header.starts_with("YUV4MPEG2 W33 H17 F24000:1001 Ip A1:1 C444")) << header;
    ASSERT_EQ(frames.size(), 3u);
    const double scale = std::string(bits) == "8" ? 1 : 4;
    double most = 0;
    for (size_t i = 0; i < 3; ++i) {
      for (size_t at = 0; at < 33 * 17; ++at) {
        double rgb[3];
        for (size_t c = 0; c < 3; ++c) rgb[c] = pictures[i].codes[3 * at + c] / 65535.0;
        const double y = .299 * rgb[0] + .587 * rgb[1] + .114 * rgb[2];  // BT.601, of so few lines
        const double wanted[3] = {16 + 219 * y, 128 + 224 * (rgb[2] - y) / 1.772,
                                  128 + 224 * (rgb[0] - y) / 1.402};
        for (size_t plane = 0; plane < 3; ++plane) {
          most = std::max(most, std::fabs(frames[i].codes[plane * 33 * 17 + at] - scale * wanted[plane]));
        }
      }
    }
    EXPECT_LE(most, 0.501) << bits;
  }
  // What players take, with the text on stderr.
  const Outcome usual = candela({"stream", in(), "-"});
  ASSERT_EQ(usual.code, 0) << usual.err;
  EXPECT_TRUE(says(usual.err, "3 of 3 frames -> standard output"));
  std::string header;
  EXPECT_EQ(y4m_frames(usual.out, header).size(), 3u);
  EXPECT_TRUE(says(header, "F24:1 Ip A1:1 C420mpeg2 XYSCSS=420MPEG2 XCOLORRANGE=LIMITED\n"));
}

TEST_F(Pipes, ThroughBothPipesFramesAreThoseOfFiles) {
  make_frames(4);
  const Outcome files = candela({"stream", in(), "-", "--pipe", "y4m", "--bits", "10", "-q"});
  const Outcome piped = fed(all_frames(), {"stream", "-", "-", "--pipe", "y4m", "--bits", "10", "-q"});
  EXPECT_EQ(piped.code, 0) << piped.err;
  EXPECT_TRUE(piped.out == files.out);
  EXPECT_GT(piped.out.size(), 4u * 64 * 48 * 3);
}

TEST_F(Pipes, HeldFramesAreInTheVideo) {
  make_frames(5);
  std::filesystem::remove(in() + "/0002.exr");
  const Outcome video = candela({"stream", in(), "-", "--missing", "hold", "-q"});
  ASSERT_EQ(video.code, 0) << video.err;
  std::string header;
  const std::vector<PipedFrame> frames = y4m_frames(video.out, header);
  ASSERT_EQ(frames.size(), 5u);
  EXPECT_EQ(frames[2].codes, frames[1].codes);
  EXPECT_NE(frames[3].codes, frames[2].codes);
}

TEST_F(Pipes, RenderTakesAndGivesOneImage) {
  const std::string in = folder_.path("in.exr"), out = folder_.path("out");
  write_small_exr(in, true);
  for (const char* kind : {"png", "jpg", "tif", "avif", "exr", "pfm"}) {
    const std::string file = out + "." + kind;
    ASSERT_EQ(candela({"render", in, file, "-q"}).code, 0);
    for (const Outcome& piped : {fed(in, {"render", "-", "-", "--as", kind, "-q"}),
                                 candela({"render", in, "-", "--as", kind, "-q"})}) {
      EXPECT_EQ(piped.code, 0) << piped.err;
      EXPECT_TRUE(piped.out == read_file(file)) << kind;
    }
    const std::string second = folder_.path(std::string("second.") + kind);
    EXPECT_EQ(fed(in, {"render", "-", second, "-q"}).code, 0);
    EXPECT_EQ(read_file(second), read_file(file));
  }
  const std::string file = folder_.path("from_file.png"), piped = folder_.path("from_pipe.png");
  EXPECT_EQ(candela({"render", out + ".png", file, "-q"}).code, 0);
  EXPECT_EQ(fed(out + ".png", {"render", "-", piped, "-q"}).code, 0);
  EXPECT_EQ(read_file(file), read_file(piped));
  const Outcome told = fed(in, {"render", "-", "-"});
  EXPECT_EQ(told.out, read_file(out + ".png"));
  EXPECT_TRUE(says(told.err, "31x17"));
}

// As `ffmpeg -i IN -f image2pipe -c:v png -` writes them.
TEST_F(Pipes, PngsAreFrames) {
  make_frames(3);
  ASSERT_EQ(candela({"stream", in(), folder_.path("first/%04d.png"), "-q"}).code, 0);
  std::string all;
  for (const std::string& name : names_in(folder_.path("first")))
    all += read_file(folder_.path("first/" + name));
  write_file(folder_.path("pngs"), all);
  ASSERT_EQ(candela({"stream", folder_.path("first/*.png"), folder_.path("files/%04d.png"), "-q"}).code, 0);
  const Outcome piped =
      fed(folder_.path("pngs"), {"stream", "-", folder_.path("piped/%04d.png"), "-q", "--first", "0"});
  ASSERT_EQ(piped.code, 0) << piped.err;
  for (const std::string& name : names_in(folder_.path("files"))) {
    EXPECT_EQ(read_file(folder_.path("piped/" + name)), read_file(folder_.path("files/" + name))) << name;
  }
  EXPECT_EQ(names_in(folder_.path("piped")).size(), 3u);
}

// As `ffmpeg -i IN -f yuv4mpegpipe -` writes it.
TEST_F(Pipes, AY4mIsFramesWithARate) {
  make_frames(3);
  const std::string made = folder_.path("made"), again = folder_.path("again/%d.png");
  const Outcome first =
      fed(all_frames(), {"stream", "-", "-", "-q", "--pipe", "y4m444", "--fps", "30000/1001"});
  ASSERT_EQ(first.code, 0) << first.err;
  write_file(made, first.out);
  const std::vector<std::string> as_it_is = {"--curve",           "linear", "--exposure", "0",
                                             "--bloom-intensity", "0"};
  const Outcome back = fed(made, with({"stream", "-", "-", "-q", "--pipe", "y4m444"}, as_it_is));
  ASSERT_EQ(back.code, 0) << back.err;
  std::string header, header_back;
  const std::vector<PipedFrame> before = y4m_frames(first.out, header);
  const std::vector<PipedFrame> after = y4m_frames(back.out, header_back);
  EXPECT_EQ(header_back, header);  // with the rate
  ASSERT_EQ(after.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    for (size_t k = 0; k < before[i].codes.size(); ++k) {
      ASSERT_NEAR(after[i].codes[k], before[i].codes[k], 1) << i << " " << k;
    }
  }
  const Outcome told = fed(made, {"stream", "-", again, "--json", "-", "-q", "--input-transfer", "pq"});
  ASSERT_EQ(told.code, 0) << told.err;
  EXPECT_EQ(lines_of(told.out).at(0).at("exposure"), 1.0);
  EXPECT_EQ(lines_of(told.out).at(0).at("primaries").at("name"), "Rec.2020");
  write_file(made, first.out.substr(0, first.out.size() - 10));
  expect_line(fed(made, {"stream", "-", again, "-q"}), 3,
              "standard input, frame 3: the file is truncated: 10 of 9216 bytes of the frame are missing");
}

TEST_F(Pipes, ABrokenFrameIsNamedAndThoseBeforeItAreThere) {
  make_frames(4);
  const std::string all = read_file(all_frames()), cut = folder_.path("cut"), junk = folder_.path("junk");
  write_file(cut, all.substr(0, all.size() - 100));
  write_file(junk, all + "junk" + all);
  Outcome outcome = fed(cut, {"stream", "-", "-", "-q"});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_TRUE(says(outcome.err, "candela: error: standard input, frame 4: "));
  std::string header;
  EXPECT_EQ(y4m_frames(outcome.out, header).size(), 3u);
  // A frame that is whole, and cannot be read.
  outcome = fed(cut, {"stream", "-", "-", "--skip-bad"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(says(outcome.err, "skipped: standard input, frame 4: "));
  EXPECT_EQ(y4m_frames(outcome.out, header).size(), 3u);
  // What follows cannot be read even then.
  for (const bool skip : {false, true}) {
    std::vector<std::string> arguments = {"stream", "-", folder_.path("out"), "-q", "--json", "-"};
    if (skip) arguments.emplace_back("--skip-bad");
    outcome = fed(junk, arguments);
    EXPECT_EQ(outcome.code, 3) << outcome.err;
    EXPECT_TRUE(says(outcome.err, "standard input, frame 5: here no PFM, PHM, PNG, OpenEXR or y4m begins"));
    const Json last = lines_of(outcome.out).back();
    EXPECT_EQ(last.at("error").at("input"), "standard input, frame 5");
    EXPECT_EQ(names_in(folder_.path("out")).size(), 4u);
  }
}

TEST_F(Pipes, WhatCannotBeIsSaidInOneLine) {
  make_frames(2);
  const std::string all = all_frames(), a = in() + "/0000.exr", out = folder_.path("o.png");
  const std::string other = folder_.path("other.pfm"), sizes = folder_.path("sizes");
  expect_line(candela({"stream", "-", "-", "-q"}), 3, "standard input: it ended before a frame came");
  expect_line(candela({"render", "-", out, "-q"}), 3, "standard input: the file is empty");
  expect_line(candela({"render", "-", "-", "-q"}), 3, "standard input: the file is empty");
  expect_line(candela({"stream", "-", "-", "--range", "1-2"}), 2, "--range chooses among files");
  expect_line(candela({"stream", "-", "-", "--missing", "hold"}), 2, "--missing is about numbers of files");
  expect_line(candela({"stream", "-", in(), "-"}), 2, "IN is \"-\" beside others");
  expect_line(candela({"stream", in(), "-", "--pipe", "y5m"}), 2, "unknown --pipe word \"y5m\"");
  expect_line(candela({"stream", in(), folder_.path("o"), "--pipe", "y4m"}), 2, "--pipe y4m is for standard");
  expect_line(candela({"stream", in(), folder_.path("o"), "--bits", "10"}), 2, "--bits 10 is for y4m");
  expect_line(candela({"stream", in(), "-", "--bits", "16"}), 2, "--bits 16 is for");
  expect_line(candela({"stream", in(), "-", "--pipe", "pam", "--bits", "10"}), 2, "--bits 10 is for y4m");
  expect_line(candela({"stream", in(), "-", "--encoding", "png"}), 2, "--encoding is for images");
  expect_line(candela({"stream", in(), "-", "--quality", "9"}), 2,
              "--quality is for .jpg or .avif; y4m loses nothing");
  expect_line(candela({"render", a, "-", "--as", "gif"}), 2, "unknown kind \"gif\"");
  expect_line(candela({"render", a, all, "-"}), 2, "OUT is \"-\", which takes one image");
  expect_line(candela({"render", "-", folder_.path("o/")}), 2, "which has no name for a file in");
  EXPECT_EQ(candela({"stream", in(), "-", "--json", "-", "-q"}).code, 2);
  EXPECT_EQ(candela({"render", a, "-", "--json", "/dev/stdout", "-q"}).code, 2);
  ASSERT_EQ(candela({"sample", other, "--size", "8x8", "-q"}).code, 0);
  write_file(sizes, read_file(a) + read_file(other));
  const Outcome mixed = fed(sizes, {"stream", "-", "-", "-q"});
  EXPECT_EQ(mixed.code, 3);
  EXPECT_TRUE(says(
      mixed.err, "standard input, frame 2: its image is 8x8, and a y4m has frames of one size, here 64x48"));
  EXPECT_EQ(pam_frames(fed(sizes, {"stream", "-", "-", "-q", "--pipe", "pam"}).out).size(), 2u);
}

TEST_F(Pipes, JsonGoesToItsOwnFile) {
  make_frames(2);
  const std::string json = folder_.path("a.json");
  const Outcome video = candela({"stream", in(), "-", "-q", "--json", json});
  EXPECT_EQ(video.code, 0) << video.err;
  EXPECT_EQ(lines_of(read_file(json)).size(), 3u);
  EXPECT_EQ(lines_of(read_file(json))[0].at("output"), "-");
  EXPECT_TRUE(video.out.starts_with("YUV4MPEG2"));
}

// The exit code says that nothing failed, as with any text (docs/failures.md).
TEST_F(Pipes, AReaderThatGoesAwayEndsIt) {
  make_frames(8, "640x480");
  const auto read_by = [&](const std::string& reader, const std::vector<std::string>& arguments) {
    const std::string fifo = folder_.path(absl::StrFormat("out%d", fifos_++));
    return candela_in_shell(
        "mkfifo " + fifo + " && { " + reader + " < " + fifo + " > /dev/null & } && exec > " + fifo,
        arguments);
  };
  const Outcome video = read_by("head -c 1000000", {"stream", in(), "-"});
  EXPECT_EQ(video.code, 0) << video.err;
  EXPECT_TRUE(says(video.err, "note: whoever read standard output stopped after "));
  const std::string saved = folder_.path("saved.json");
  const Outcome saves = read_by("head -c 1000000", {"stream", in(), "-", "-q", "--save-exposures", saved});
  EXPECT_EQ(saves.code, 5);
  EXPECT_TRUE(says(saves.err, "stopped before the last frame"));
  EXPECT_FALSE(std::filesystem::exists(saved));
  EXPECT_EQ(read_by("head -c 1", {"render", in() + "/0000.exr", "-", "--as", "pfm", "-q"}).code, 0);
  // While it waits for a frame that does not come.
  const std::string forever = folder_.path("forever"), all = all_frames();
  const auto begin = std::chrono::steady_clock::now();
  const Outcome waits =
      candela_in_shell("mkfifo " + forever + " " + forever + "2 && { { cat " + all + "; sleep 30; } > " +
                           forever + " 2> /dev/null & } && exec < " + forever + " && { head -c 1000 < " +
                           forever + "2 > /dev/null & } && exec > " + forever + "2",
                       {"stream", "-", "-", "-q"});
  EXPECT_EQ(waits.code, 0) << waits.err;
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(25));
}

TEST_F(Pipes, AFullDiskAndAClosedOutputAreFailures) {
  make_frames(2);
  for (const std::string& output : {std::string("exec > /dev/full"), std::string("exec >&-")}) {
    for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
             {"stream", in(), "-", "-q"}, {"render", in() + "/0000.exr", "-", "-q"}}) {
      const Outcome outcome = candela_in_shell(output, arguments);
      EXPECT_EQ(outcome.code, 5) << outcome.err;
      EXPECT_TRUE(says(outcome.err, "standard output: cannot write: "));
    }
  }
}

}  // namespace
}  // namespace candela
