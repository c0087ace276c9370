// `candela stream` into a film, with the ffmpeg that is installed. Without one the tests are skipped.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/time/clock.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/cli/stream_fixture.h"
#include "tests/support/files.h"
#include "tests/support/process.h"
#include "tests/support/status.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

class Films : public StreamFixture {
 protected:
  void SetUp() override {
    if (std::system("ffmpeg -version > /dev/null 2>&1") != 0) GTEST_SKIP() << "there is no ffmpeg";
    make_frames(6);
  }
  void make_others(int frames, const std::string& size) {
    std::filesystem::remove_all(in());
    make_frames(frames, size);
  }

  // The standard output of a shell's command.
  std::string said(const std::string& command) {
    const std::string file = folder_.path("said");
    EXPECT_EQ(std::system((command + " > " + file).c_str()), 0) << command;
    return read_file(file);
  }
  std::string facts(const std::string& film) {
    return said(
        "ffprobe -v error -count_frames -of default=nw=1 -show_entries "
        "stream=codec_name,profile,codec_tag_string,width,height,pix_fmt,color_range,color_space,"
        "color_transfer,color_primaries,chroma_location,r_frame_rate,nb_read_frames " +
        film);
  }
  // R, G and B of all frames, 8 bits each.
  std::string decoded(const std::string& film) {
    return said("ffmpeg -v error -i " + film +
                " -vf scale=flags=accurate_rnd+full_chroma_int+full_chroma_inp -pix_fmt rgb24 -f rawvideo -");
  }
  struct Distance {
    int most = 0;
    double beyond_two = 0;          // the part of the codes that are further away
    std::array<double, 3> shift{};  // on average, of R, G and B
  };
  // Of the frames' codes from those of the PNGs in "out".
  Distance from_pngs(const std::string& codes) {
    Distance distance;
    size_t at = 0;
    for (const std::string& name : names_in(folder_.path("out"))) {
      const Png png = read_png(folder_.path("out/") + name);
      for (uint32_t i = 0; i < png.width * png.height * 3; ++i, ++at) {
        const int off = static_cast<unsigned char>(codes.at(at)) -
                        png.code(i / 3 % png.width, i / 3 / png.width, static_cast<int>(i % 3));
        distance.most = std::max(distance.most, std::abs(off));
        distance.beyond_two += std::abs(off) > 2 ? 1.0 / static_cast<double>(codes.size()) : 0;
        distance.shift[i % 3] += 3.0 * off / static_cast<double>(codes.size());
      }
    }
    EXPECT_EQ(codes.size(), at);
    return distance;
  }
  // The names in the films' folder are these.
  void expect_folder(const std::vector<std::string>& names) {
    EXPECT_EQ(names_in(folder_.path("films")), names);
  }
  std::string film(const std::string& name) const { return folder_.path("films/") + name; }
  // A program named ffmpeg, in place of the installed one.
  std::string path_with_ffmpeg(const std::string& script) {
    const std::string bin = folder_.path("bin");
    std::filesystem::create_directories(bin);
    write_file(bin + "/ffmpeg", "#!/bin/sh\n" + script + "\n");
    chmod((bin + "/ffmpeg").c_str(), 0755);
    return "export PATH=" + bin + ":$PATH";
  }
};

TEST_F(Films, EachCodecMakesATaggedFilmOfEveryFrame) {
  struct Case {
    const char* name;
    std::vector<std::string> options;
    std::vector<const char*> facts;
  };
  const std::vector<Case> cases = {
      {"a.mp4",
       {},
       {"codec_name=h264", "codec_tag_string=avc1", "pix_fmt=yuv420p\n", "chroma_location=left"}},
      {"b.mov", {"--bits", "10"}, {"codec_name=h264", "pix_fmt=yuv420p10le"}},
      {"c.MKV", {"--pipe", "y4m444"}, {"codec_name=h264", "pix_fmt=yuv444p\n"}},
      {"d.mp4", {"--codec", "hevc"}, {"codec_name=hevc", "codec_tag_string=hvc1", "pix_fmt=yuv420p\n"}},
      {"e.webm", {}, {"codec_name=av1", "pix_fmt=yuv420p\n"}},
      {"f.mov", {"--codec", "prores"}, {"codec_name=prores", "profile=HQ", "pix_fmt=yuv422p10le"}},
      {"g.mov", {"--codec", "prores", "--pipe", "y4m444"}, {"codec_name=prores", "profile=4444"}},
  };
  std::vector<std::string> names;
  for (const Case& made : cases) {
    SCOPED_TRACE(made.name);
    names.emplace_back(made.name);
    const Outcome outcome =
        candela(with({"stream", in(), film(made.name), "--fps", "24000/1001"}, made.options));
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(says(outcome.out, "6 of 6 frames -> " + film(made.name)));
    const std::string about = facts(film(made.name));
    for (const char* fact : made.facts) EXPECT_TRUE(says(about, fact));
    for (const char* fact :
         {"width=64\nheight=48\n", "color_range=tv", "color_space=bt709", "color_transfer=iec61966-2-1",
          "color_primaries=bt709", "r_frame_rate=24000/1001", "nb_read_frames=6"}) {
      EXPECT_TRUE(says(about, fact));
    }
  }
  expect_folder(names);
}

TEST_F(Films, AnHdrFilmNamesItsDisplay) {
  struct Case {
    const char* name;
    std::vector<std::string> options;
    std::vector<const char*> facts;
  };
  for (const Case& made :
       std::vector<Case>{{"pq.mp4",
                          {"--codec", "hevc", "--transfer", "pq"},
                          {"codec_name=hevc", "pix_fmt=yuv420p10le", "color_space=bt2020nc",
                           "color_transfer=smpte2084", "color_primaries=bt2020"}},
                         {"hlg.mov",
                          {"--codec", "prores", "--transfer", "hlg", "--display-primaries", "p3-d65"},
                          {"codec_name=prores", "color_space=bt709", "color_transfer=arib-std-b67",
                           "color_primaries=smpte432"}}}) {
    const Outcome outcome = candela(with({"stream", in(), film(made.name), "--fps", "24"}, made.options));
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const std::string about = facts(film(made.name));
    for (const char* fact : made.facts) EXPECT_TRUE(says(about, fact));
  }
  EXPECT_TRUE(says(said("ffprobe -v error -read_intervals %+#1 -show_frames " + film("pq.mp4")),
                   "max_luminance=10000000/10000"));
  const Outcome refused =
      candela({"stream", in(), film("no.mp4"), "--fps", "24", "--transfer", "pq", "--bits", "8"});
  EXPECT_EQ(refused.code, 2);
}

// The codecs lose detail, so ProRes is within 2 codes nearly everywhere, and the others are so on average. A
// wrong matrix or range shifts all of a colour.
TEST_F(Films, ColoursAreThoseOfThePngs) {
  make_others(3, "320x180");
  stream({});
  for (const auto& [name, options] : std::vector<std::pair<std::string, std::vector<std::string>>>{
           {"a.mov", {"--codec", "prores", "--pipe", "y4m444"}},
           {"b.mkv", {"--pipe", "y4m444"}},
           {"c.mkv", {"--pipe", "y4m444", "--bits", "10", "--codec", "hevc"}},
           {"d.mp4", {"--codec", "av1"}},
           {"e.mp4", {}}}) {
    SCOPED_TRACE(name);
    ASSERT_EQ(candela(with({"stream", in(), film(name), "-q"}, options)).code, 0);
    const Distance distance = from_pngs(decoded(film(name)));
    for (const double shift : distance.shift) EXPECT_LT(std::fabs(shift), .5);
    if (name == "a.mov") {
      EXPECT_LE(distance.beyond_two, .002);
    }
  }
}

TEST_F(Films, AFilmWithoutLossIsWithinTwoCodesOfThePngs) {
  make_others(3, "320x180");
  stream({});
  const Outcome told = candela({"stream", in(), film("a.mkv"), "-v", "--pipe", "y4m444"});
  ASSERT_EQ(told.code, 0) << told.err;
  const std::string command =
      absl::StrReplaceAll(told.err.substr(6, told.err.find('\n') - 6), {{"-crf 18", "-qp 0"}});
  const std::string frames = folder_.path("frames.y4m");
  write_file(frames, candela({"stream", in(), "-", "-q", "--pipe", "y4m444", "--pipe-matrix", "bt709"}).out);
  ASSERT_EQ(std::system((command + " < " + frames).c_str()), 0);
  EXPECT_TRUE(says(facts(film("a.mkv")), "profile=High 4:4:4 Predictive"));
  const Distance distance = from_pngs(decoded(film("a.mkv")));
  EXPECT_LE(distance.most, 2);
  EXPECT_GE(distance.most, 1) << "nothing was compared";
}

TEST_F(Films, HeldFramesAreInThem) {
  std::filesystem::remove(in() + "/0002.exr");
  ASSERT_EQ(candela({"stream", in(), film("a.mkv"), "-q", "--missing", "hold", "--pipe", "y4m444"}).code, 0);
  EXPECT_TRUE(says(facts(film("a.mkv")), "nb_read_frames=6"));
}

TEST_F(Films, VerboseSaysACommandLineThatMakesTheSame) {
  const std::string told = film("it's.mp4");
  const Outcome outcome = candela({"stream", in(), told, "-v", "--codec", "hevc", "--fps", "12"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const std::string first = read_file(told), begin = "note: ffmpeg -hide_banner ";
  ASSERT_TRUE(outcome.err.starts_with(begin)) << outcome.err;
  const std::string command = outcome.err.substr(6, outcome.err.find('\n') - 6);
  const std::string frames = folder_.path("frames.y4m");
  write_file(frames, candela({"stream", in(), "-", "-q", "--fps", "12", "--pipe-matrix", "bt709"}).out);
  ASSERT_EQ(std::system((command + " < " + frames).c_str()), 0);
  EXPECT_EQ(read_file(told), first);
}

TEST_F(Films, WhatCannotBeIsSaidInOneLine) {
  const auto refused = [&](const std::string& name, const std::vector<std::string>& options, int code,
                           const std::string& words) {
    const Outcome outcome = candela(with({"stream", in(), film(name), "-q"}, options));
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  };
  refused("a.webm", {"--codec", "h264"}, 2, "cannot hold it; write .mp4, .mov or .mkv");
  refused("a.mp4", {"--codec", "prores"}, 2, "cannot hold it; write .mov or .mkv");
  refused("a.mp4", {"--codec", "h265"}, 2, "unknown --codec word \"h265\"");
  refused("a.mov", {"--codec", "prores", "--bits", "8"}, 2, "prores has 10 bits");
  refused("a.mp4", {"--bits", "16"}, 2, "--bits 16 is for");
  refused("a.mp4", {"--pipe", "pam"}, 2, "a film is of y4m");
  refused("a.mp4", {"--pipe-matrix", "bt601"}, 2, "a film names its matrix; leave it out");
  refused("a.mp4", {"--quality", "9"}, 2, "--quality is for .jpg");
  refused("a.mp4", {"--encoding", "png"}, 2, "where --codec chooses");
  refused("%04d.png", {"--codec", "h264"}, 2, "--codec h264 is for films");
  refused("a.mp4", {"--json", film("a.mp4")}, 2, "would be one file");
  std::filesystem::remove_all(folder_.path("films"));
  make_others(2, "33x17");
  refused("odd.mp4", {}, 3, "it is 33x17, and this film needs even sizes; --pipe y4m444");
  EXPECT_EQ(candela({"stream", in(), film("odd.mp4"), "-q", "--pipe", "y4m444"}).code, 0);
  expect_folder({"odd.mp4"});
}

TEST_F(Films, AFailureOfFfmpegIsSaidAndLeavesNoFilm) {
  const auto fails = [&](const std::string& before, int code, const std::string& words) {
    const Outcome outcome = candela_in_shell(before, {"stream", in(), film("a.mp4"), "-q", "--json", "-"});
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
    EXPECT_EQ(lines_of(outcome.out).back().at("error").at("code"), code);
    expect_folder({"a.mp4"});
    EXPECT_EQ(read_file(film("a.mp4")), "old") << words;
  };
  std::filesystem::create_directories(folder_.path("films"));
  write_file(film("a.mp4"), "old");
  fails("PATH=/nowhere", 1, "ffmpeg makes films, and it is not installed; apt-get install ffmpeg");
  fails(path_with_ffmpeg("head -c 1000 > /dev/null; echo Unknown encoder >&2; exit 3"), 5,
        "cannot write: ffmpeg failed (3): Unknown encoder");
  fails(path_with_ffmpeg("cat > /dev/null; echo one >&2; echo two >&2; exit 1"), 5,
        "ffmpeg failed (1): one; two");
  fails(path_with_ffmpeg("head -c 1000 > /dev/null; kill -9 $$"), 5, "a signal (9) ended ffmpeg");
  for (const char* script : {"exit 0", "cat > /dev/null"}) {
    fails(path_with_ffmpeg(script), 5, "ffmpeg ended before it made the film");
  }
  // More words than a pipe holds, while frames wait.
  fails(path_with_ffmpeg("head -c 200000 /dev/zero | tr '\\0' x >&2; echo >&2; echo end >&2; exit 1"), 5,
        "end");
  // A full disk, as the limit of files is one.
  fails("ulimit -f 1", 5, "File too large");
  // A frame that cannot be read ends the film, too.
  write_file(in() + "/0003.exr", "no picture");
  fails("true", 3, "0003.exr");
  ASSERT_EQ(candela({"stream", in(), film("a.mp4"), "-q", "--skip-bad"}).code, 0);
  EXPECT_TRUE(says(facts(film("a.mp4")), "nb_read_frames=5"));
}

TEST_F(Films, ASignalLeavesNoFilmAndNoFfmpeg) {
  std::filesystem::create_directories(folder_.path("films"));
  const std::string alive = folder_.path("alive");
  // The encoder says who it is, and takes nothing: the command waits for it.
  const Variable path("PATH", (folder_.path("bin") + ":" + std::getenv("PATH")).c_str());
  path_with_ffmpeg("echo $$ > " + alive + "; exec sleep 60");
  make_others(2, "640x480");
  const Outcome outcome = candela_with_signal({"stream", in(), film("a.mp4"), "-q"}, SIGINT, 1500);
  EXPECT_EQ(outcome.code, 128 + SIGINT);
  expect_folder({});
  const int pid = std::atoi(read_file(alive).c_str());
  ASSERT_GT(pid, 0);
  // The kernel ends it when it gets to it, long before its minute is over.
  const auto is_gone = [pid] {
    return kill(pid, 0) != 0 || absl::StrContains(read_file(absl::StrFormat("/proc/%d/stat", pid)), ") Z");
  };
  for (int i = 0; i < 200 && !is_gone(); ++i) absl::SleepFor(absl::Milliseconds(100));
  EXPECT_TRUE(is_gone());
}

}  // namespace
}  // namespace candela
