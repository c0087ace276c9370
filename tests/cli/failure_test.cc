// How a command ends that fails: its exit code says in what way (docs/failures.md), and its JSON says it in a
// line.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <filesystem>

#include "absl/strings/str_split.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using Json = nlohmann::json;

enum Code { kOther = 1, kUsage = 2, kInput = 3, kServer = 4, kOutput = 5 };

std::vector<Json> lines_of(const std::string& text) {
  std::vector<Json> lines;
  for (const absl::string_view line : absl::StrSplit(text, '\n', absl::SkipEmpty())) {
    lines.push_back(Json::parse(line, nullptr, false));
  }
  return lines;
}

class FailureEnds : public ::testing::Test {
 protected:
  void SetUp() override {
    write_small_exr(in_);
    write_file(text_, "this is no image\n");
    std::filesystem::create_directory(empty_);
    std::filesystem::create_directory(folder_.path("film"));
    for (const char* name : {"0001.exr", "0002.exr"}) write_small_exr(folder_.path("film/") + name);
  }

  // The command ends with this code, and its last line of JSON says why: with the code, in the words of
  // stderr.
  Json expect_failure(std::vector<std::string> arguments, int code) const {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    arguments.insert(arguments.end(), {"--json", "-"});
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    const std::vector<Json> lines = lines_of(outcome.out);
    if (lines.empty() || !lines.back().is_object() || !lines.back().contains("error")) {
      ADD_FAILURE() << "no failure in " << outcome.out;
      return {};
    }
    const Json error = lines.back().at("error");
    EXPECT_EQ(error.at("code"), code);
    const char* const words[] = {"", "other", "usage", "input", "server", "output"};
    EXPECT_EQ(error.at("kind"), words[code]);
    EXPECT_TRUE(says(outcome.err, "candela: error: " + error.at("message").get<std::string>())) << error;
    EXPECT_EQ(error.size(), 4u) << error;
    return error;
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string text_ = folder_.path("text.exr");
  const std::string empty_ = folder_.path("empty");
  const std::string film_ = folder_.path("film");
  const std::string out_ = folder_.path("out.png");
  const std::string frames_ = folder_.path("frames");
  const std::string missing_ = folder_.path("missing.exr");
};

TEST_F(FailureEnds, AWrongCommandLineIsUsage) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"render", in_, out_, "--exposure", "much"},
           {"render", in_, out_, "--exposrue", "1"},
           {"render", in_, in_},
           {"render", in_, out_, "--spot", "900,0,910,10"},
           {"render", in_, out_, "--tier", "standrd"},
           {"stream", film_, folder_.path("one.png")},
           {"stream", film_, frames_, "--encoding", "jpeg", "--alpha", "straight"},
           {"view", in_, out_, "--fov", "0"},
           {"environment", in_, folder_.path("sky.hdr")},
           {"meter", in_, "--percentiles", "1"},
           {"bench", "--sessions", "0"},
           {"info", "--server", "a:b"}}) {
    EXPECT_EQ(expect_failure(arguments, kUsage).value("message", "").find('\n'), std::string::npos);
  }
}

TEST_F(FailureEnds, AnInputThatCannotBeReadIsInputInEveryCommand) {
  const std::string sky = folder_.path("sky.ktx2");
  for (const std::string& bad : {missing_, text_, empty_}) {
    for (const std::vector<std::string>& arguments :
         std::vector<std::vector<std::string>>{{"meter", bad},
                                               {"view", bad, out_},
                                               {"environment", bad, sky},
                                               {"info", bad},
                                               {"stream", bad, frames_}}) {
      EXPECT_EQ(expect_failure(arguments, kInput).at("input"), bad) << arguments[0];
    }
    if (bad != empty_) {
      EXPECT_EQ(expect_failure({"render", bad, out_}, kInput).at("input"), bad);
    }
  }
  expect_failure({"render", empty_, frames_ + "/"}, kInput);
  expect_failure({"render", folder_.path("none*.exr"), frames_ + "/"}, kInput);
  expect_failure({"stream", folder_.path("film/%04d.exr"), frames_, "--range", "1-3"}, kInput);
  expect_failure({"render", in_, out_, "--layer", "depth"}, kInput);
  expect_failure({"render", in_, out_, "--locked-exposure", text_}, kInput);
  expect_failure({"render", in_, out_, "--ocio", text_}, kInput);
  expect_failure({"view", in_, out_, "--objects", text_}, kInput);
  expect_failure({"view", in_, frames_, "--path", missing_}, kInput);
  EXPECT_EQ(candela({"report", folder_.path("page"), "--quick", "--images", missing_, "-q"}).code, kInput);
}

TEST_F(FailureEnds, ARefusedPictureIsInput) {
  std::string pfm = "PF\n2 1\n-1.0\n";
  const float pixels[] = {1, 1, 1, 1, __builtin_nanf(""), 1};
  pfm.append(reinterpret_cast<const char*>(pixels), sizeof pixels);
  const std::string nan = folder_.path("nan.pfm");
  write_file(nan, pfm);
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"render", nan, out_},
                                             {"stream", nan, frames_},
                                             {"meter", nan},
                                             {"view", nan, out_},
                                             {"environment", nan, folder_.path("sky.ktx2")}}) {
    std::vector<std::string> rejecting = arguments;
    rejecting.insert(rejecting.end(), {"--bad-values", "reject"});
    EXPECT_EQ(expect_failure(rejecting, kInput).at("input"), nan);
  }
}

TEST_F(FailureEnds, AnOutputThatCannotBeWrittenIsOutputInEveryCommand) {
  const std::string under_file = in_ + "/folder/";
  expect_failure({"render", in_, under_file + "out.png"}, kOutput);
  expect_failure({"render", in_, out_, "--error-map", under_file + "map.png"}, kOutput);
  expect_failure({"stream", film_, under_file + "out"}, kOutput);
  expect_failure({"stream", film_, frames_, "--save-exposures", under_file + "a.json"}, kOutput);
  expect_failure({"meter", film_, "--save-exposures", under_file + "a.json"}, kOutput);
  expect_failure({"view", in_, under_file + "out.png"}, kOutput);
  expect_failure({"view", in_, under_file + "out", "--turn", "360", "--frames", "2"}, kOutput);
  expect_failure({"environment", in_, under_file + "sky.ktx2"}, kOutput);
  expect_failure({"environment", in_, folder_.path("sky.ktx2"), "--preview", under_file + "p.png"}, kOutput);
  EXPECT_EQ(candela({"sample", under_file + "a.exr", "-q"}).code, kOutput);
  EXPECT_EQ(candela({"report", under_file + "page", "-q"}).code, kOutput);
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"render", in_, out_}, {"stream", film_, frames_}, {"meter", in_}, {"info", in_}, {"info"}}) {
    for (const std::string& json : {std::string("/dev/full"), under_file + "a.json"}) {
      std::vector<std::string> full = arguments;
      full.insert(full.end(), {"--json", json});
      EXPECT_EQ(candela(full).code, kOutput) << ::testing::PrintToString(full);
    }
  }
  EXPECT_EQ(candela_in_shell("exec >/dev/full", {"render", in_, out_}).code, kOutput);
  EXPECT_EQ(candela_in_shell("exec >&-", {"render", in_, out_, "--json", "-"}).code, kOutput);
}

#ifndef CANDELA_SANITIZED  // a sanitizer wants to be loaded first
TEST_F(FailureEnds, AFullDiskIsOutput) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"render", in_, out_},
                                             {"render", in_, folder_.path("film/0001.exr"), frames_ + "/"},
                                             {"stream", film_, frames_},
                                             {"view", in_, out_, "--size", "8x8"},
                                             {"environment", in_, folder_.path("sky.ktx2"), "--size", "16"},
                                             {"sample", folder_.path("scene.exr"), "--size", "8x8"}}) {
    EXPECT_EQ(candela_on_failing_machine("CANDELA_TEST_DISK_BYTES", "0", arguments).code, kOutput)
        << ::testing::PrintToString(arguments);
  }
}

TEST_F(FailureEnds, AMachineWithoutMemoryOrThreadsIsNone) {
  EXPECT_EQ(candela_with_ulimit("-v $((500 * 1024))", {"render", in_, out_, "-q"}).code, kOther);
  EXPECT_EQ(candela_with_ulimit("-n 10", {"render", in_, out_, "-q"}).code, kOther);
  EXPECT_EQ(
      candela_on_failing_machine("CANDELA_TEST_STD_THREADS", "0", {"stream", film_, frames_, "-q"}).code,
      kOther);
}
#endif

TEST_F(FailureEnds, AServerThatIsNotThereIsServerInEveryCommand) {
  const std::string nowhere = "unix:" + folder_.path("socket");
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"render", in_, out_},
                                             {"render", in_, folder_.path("film/0001.exr"), frames_ + "/"},
                                             {"stream", film_, frames_},
                                             {"meter", in_},
                                             {"meter", film_},
                                             {"view", in_, out_},
                                             {"environment", in_, folder_.path("sky.ktx2")},
                                             {"bench"},
                                             {"info"}}) {
    for (const std::string& server : {nowhere, std::string("127.0.0.1:1")}) {
      std::vector<std::string> there = arguments;
      there.insert(there.end(), {"--server", server});
      EXPECT_TRUE(says(expect_failure(there, kServer).value("message", ""), "cannot reach " + server));
    }
  }
  EXPECT_EQ(candela({"report", folder_.path("page"), "-q", "--server", nowhere}).code, kServer);
  EXPECT_EQ(candela({"health", "--server", nowhere}).code, 1) << "a probe has three codes";
  EXPECT_EQ(candela_in_shell("exec >/dev/full", {"health", "--server", nowhere}).code, 1);
  EXPECT_EQ(candela({"health", "--server", "a:b"}).code, 2);
}

TEST_F(FailureEnds, AServerThatTakesNoSuchFrameMakesItTheInputs) {
  const ListeningDaemon daemon({"--max-dimension", "30"});
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"render", in_, out_}, {"stream", film_, frames_}, {"meter", in_}}) {
    std::vector<std::string> there = arguments;
    there.insert(there.end(), {"--server", daemon.address()});
    expect_failure(there, kInput);
  }
}

TEST_F(FailureEnds, ATokenOrTlsThatDoesNotFitIsServer) {
  write_file(folder_.path("tokens"), "the-right-token-of-this-test\n");
  write_file(folder_.path("token"), "another-token-of-this-test\n");
  for (const char* name : {"tokens", "token"}) chmod(folder_.path(name).c_str(), 0600);
  const ListeningDaemon daemon({"--token-file", folder_.path("tokens")});
  expect_failure({"info", "--server", daemon.address()}, kServer);
  expect_failure({"render", in_, out_, "--server", daemon.address(), "--token-file", folder_.path("token")},
                 kServer);
  const ListeningDaemon plain;
  expect_failure({"info", "--server", plain.address(), "--tls"}, kServer);
}

TEST_F(FailureEnds, ADeviceThatIsNotThereIsServer) {
  expect_failure({"render", in_, out_, "--device", "no such device"}, kServer);
}

TEST_F(FailureEnds, SeveralFailuresOfOneKindHaveItsCodeAndOthersHaveOne) {
  const std::string folder = frames_ + "/";
  EXPECT_EQ(candela({"render", text_, missing_, in_, folder, "-q"}).code, kInput);
  EXPECT_EQ(candela({"info", text_, missing_, in_}).code, kInput);
  // The picture of in.exr cannot be written.
  std::filesystem::remove(frames_ + "/in.png");
  std::filesystem::create_directories(frames_ + "/in.png");
  EXPECT_EQ(candela({"render", film_ + "/0001.exr", in_, folder, "-q"}).code, kOutput);
  const Outcome mixed = candela({"render", text_, in_, film_ + "/0001.exr", folder, "--json", "-"});
  EXPECT_EQ(mixed.code, kOther);
  const std::vector<Json> lines = lines_of(mixed.out);
  ASSERT_EQ(lines.size(), 4u) << mixed.out;
  EXPECT_EQ(lines[0].at("code"), kInput);
  EXPECT_TRUE(lines[0].at("error").is_string());
  EXPECT_EQ(lines[1].at("code"), kOutput);
  EXPECT_FALSE(lines[2].contains("code"));
  EXPECT_EQ(lines[3].at("summary").at("failed"), 2);
}

TEST_F(FailureEnds, AStreamThatSkipsSaysWhatFailed) {
  write_file(folder_.path("film/0003.exr"), "no image");
  const Outcome some = candela({"stream", film_, frames_, "--skip-bad", "-q", "--json", "-"});
  EXPECT_EQ(some.code, 0) << some.err;
  EXPECT_EQ(lines_of(some.out).at(2).at("code"), kInput) << some.out;
  for (const char* name : {"0001.exr", "0002.exr"}) write_file(folder_.path("film/") + name, "no image");
  expect_failure({"stream", film_, frames_, "--skip-bad", "-q"}, kInput);
}

TEST_F(FailureEnds, TheJsonIsAFileAndMadeWithItsFolderEvenThen) {
  const std::string json = folder_.path("new/folder/a.json");
  EXPECT_EQ(candela({"render", missing_, out_, "--json", json}).code, kInput);
  EXPECT_EQ(lines_of(read_file(json)).at(0).at("error").at("input"), missing_);
  // Each failure takes the place of what was there.
  EXPECT_EQ(candela({"stream", empty_, frames_, "--json", json}).code, kInput);
  EXPECT_EQ(lines_of(read_file(json)).size(), 1u);
  EXPECT_EQ(candela({"render", in_, out_, "--exposure", "x", "--json=" + json}).code, kUsage);
  EXPECT_EQ(lines_of(read_file(json)).at(0).at("error").at("kind"), "usage");
  EXPECT_EQ(candela({"render", in_, out_, "-q", "--json", json}).code, 0);
  EXPECT_TRUE(lines_of(read_file(json)).at(0).contains("exposure"));
}

TEST_F(FailureEnds, AFailureNeverReplacesAnythingButJson) {
  const std::string image = read_file(in_), keys = folder_.path("keys.json");
  write_file(keys, "{\"keys\": []}");
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"render", in_, out_, "--exposure", "x", "--json", in_},
           {"render", in_, out_, "--json", in_},
           {"render", folder_.path("*.exr"), missing_ + "*", frames_ + "/", "--json", in_},
           {"view", in_, frames_, "--path", keys, "--json", keys},
           {"view", in_, frames_, "--path=" + keys, "--fov", "0", "--json", keys},
           {"stream", folder_.path("*.json"), folder_.path("none*"), frames_, "--json", keys}}) {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    EXPECT_NE(candela(arguments).code, 0);
    EXPECT_TRUE(read_file(in_) == image);
    EXPECT_EQ(read_file(keys), "{\"keys\": []}");
  }
}

TEST_F(FailureEnds, APipeThatNobodyReadsAnyMoreIsNoFailure) {
  const std::string command = "set -o pipefail; " + std::string(CANDELA_PROGRAM) + " info --json - | true";
  EXPECT_EQ(WEXITSTATUS(std::system(("bash -c '" + command + "'").c_str())), 0);
}

// Wrong uses and failures: each ends with its exit code and one line that says what is wrong and how to
// correct it, and leaves no file behind.

void expect_error(const Outcome& outcome, int code, const std::string& words) {
  EXPECT_EQ(outcome.code, code) << outcome.err;
  EXPECT_EQ(outcome.err.find("candela: error: "), 0u) << outcome.err;
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  EXPECT_TRUE(says(outcome.err, words));
  EXPECT_EQ(outcome.out, "");
}

TEST(Usage, EveryWrongUseNamesWhatWouldBeRight) {
  const auto render = [](std::vector<std::string> options) {
    options.insert(options.begin(), {"render", "in.exr", "out.png"});
    return options;
  };
  struct Case {
    std::vector<std::string> arguments;
    std::string words;
  };
  for (const auto& [arguments, words] : std::vector<Case>{
           {{"rendr", "a", "b"}, "unknown command \"rendr\"; did you mean render?"},
           {{"bogus"},
            "there are: render, contact, stream, meter, view, "
            "environment, sample, report, bench, info, health"},
           {{"--verson"}, "did you mean --version?"},
           {{"render"}, "IN... OUT is required"},
           {{"render", "in.exr"}, "render needs an image and an output"},
           {{"render", "a.exr", "b.exr", "c.png"}, "c.png is one file; several images need a folder"},
           {{"render", "in/*.exr", "c.png"}, "c.png is one file; several images need a folder"},
           {render({"more"}),
            "out.png is no image that candela can read (OpenEXR, Radiance, "
            "PFM, PNG, AVIF, JPEG or TIFF), and the last argument, more, is"},
           {render({"--as", "jpg"}), "--as jpg is for images in a folder"},
           {{"render", "in.exr", "out/", "--as", "jpgg"}, "did you mean jpg?"},
           {{"render", "in.exr", "out/", "--as", "jpg", "--bits", "16"}, "--bits 16 is for .png"},
           {{"render", "in.exr", "out/", "--error-map", "map.png"}, "name a file as OUT"},
           {render({"--exposre", "1"}), "unknown option --exposre; did you mean --exposure?"},
           {{"render", "--exposre=1", "a"}, "did you mean --exposure?"},
           {{"info", "--sever", "a:1"}, "did you mean --server?"},
           {render({"-q", "--exposure", "-2", "-x"}), "unknown option -x"},
           {render({"--curve"}), "--curve needs a value"},
           {render({"--curve", "aces-hil"}),
            "unknown curve \"aces-hil\"; did you mean aces-hill? There are: linear, reinhard, "
            "aces-narkowicz, aces-hill"},
           {render({"--curve", "filmic"}), "unknown curve \"filmic\"; there are: linear"},
           {render({"--transfer", "sgrb"}), "did you mean srgb?"},
           {render({"--bad-values", "rejct"}), "did you mean reject?"},
           {render({"--exposure", "atuo"}), "did you mean auto?"},
           {render({"--exposure", "41"}), "--exposure is 41; it must be -40 .. 40, or auto"},
           {render({"--compensation", "-41"}), "--compensation is -41; it must be -40 .. 40"},
           {render({"--key", "0"}), "--key is 0; it must be 1e-06 .. 1000000"},
           {render({"--key", "nan"}), "not a number"},
           {render({"--key", "0.18x"}), "\"0.18x\", which is not a number"},
           {render({"--min-exposure", "100"}), "--min-exposure 100 is above --max-exposure 64"},
           {render({"--bloom-intensity", "10.1"}), "it must be 0 .. 10"},
           {render({"--bloom-threshold", "1.1e9"}), "it must be 0 .. 2^30"},
           {render({"--bloom-softness", "-0.1"}), "it must be 0 .. 1"},
           {render({"--bloom-levels", "2.5"}), "a whole number, 1 .. 16"},
           {render({"--bloom-levels", "17"}), "1 .. 16"},
           {render({"--bloom-firefly", "maybe"}), "it must be on or off"},
           {render({"--prescale", "1e13"}), "2^-40 .. 2^40"},
           {render({"--bits", "12"}), "it must be 8 or 16"},
           {render({"--quality", "80"}), "--quality is for .jpg"},
           {{"render", "in.exr", "out.jpg", "--bits", "16"}, "--bits 16 is for .png"},
           {{"render", "in.exr", "out.jpg", "--quality", "0"}, "1 .. 100"},
           {{"render", "in.exr", "out.gif"}, "use .png, .jpg, .jpeg, .tif, .tiff, .avif, .exr or .pfm"},
           {{"render", "in.exr", "out"}, "use .png, .jpg, .jpeg, .tif, .tiff, .avif, .exr or .pfm"},
           {render({"--server", "nowhere:port"}), "neither HOST:PORT (port 1 .. 65535) nor unix:PATH"},
           {render({"--server", "a:1", "--device", "0"}), "give one of them"},
           {render({"--device", "host", "--executor", "device"}), "give one of them"},
           {render({"--error-map", "map.jpg"}), "--error-map is map.jpg; it must end in .png"},
           {render({"--error-map", "out.png"}), "OUT is the same file"},
           {{"sample", "scene.png"}, "written as .exr or .pfm"},
           {{"sample", "scene.exr", "--size", "0x5"}, "1x1 .. 16384x16384"},
           {{"sample", "scene.exr", "--size", "1920"}, "WIDTHxHEIGHT"},
           {{"sample", "scene.exr", "--size", "16385x1"}, "1x1 .. 16384x16384"},
           {{"health", "--server", "a:1", "--timeout", "0"}, "0.001 .. 3600"}}) {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    expect_error(candela(arguments), 2, words);
  }
}

class Failure : public ::testing::Test {
 protected:
  void SetUp() override {
    write_small_exr(in_);
    write_file(out_, "what was there before");
  }
  // However it fails, the old picture stays and nothing else appears.
  void TearDown() override {
    EXPECT_EQ(read_file(out_), "what was there before");
    for (const std::string& name : folder_.list()) EXPECT_FALSE(says(name, ".part"));
  }
  std::string file(const std::string& name, const std::string& bytes) {
    write_file(folder_.path(name), bytes);
    return folder_.path(name);
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string out_ = folder_.path("out.png");
};

TEST_F(Failure, InputsThatAreNoImageAreNamed) {
  const std::string whole = read_file(in_);
  std::string damaged = whole;
  damaged.replace(whole.size() - 40, 40, 40, '\x55');
  for (const auto& [path, words] : std::vector<std::pair<std::string, std::string>>{
           {folder_.path("missing.exr"), "No such file"},
           {"/dev/zero", "not a regular file"},
           {file("empty.exr", ""), "empty"},
           {file("text.exr", "this is not an image at all\n"),
            "not an OpenEXR, Radiance, PFM, PNG, AVIF, JPEG or TIFF file"},
           {file("cut.exr", whole.substr(0, whole.size() / 2)), "unfinished or cut off"},
           {file("magic.exr", whole.substr(0, 4)), "OpenEXR"},
           {file("damaged.exr", damaged), "damaged"},
           {file("cut.pfm", "PF\n10 10\n-1.0\nabc"), "cut.pfm"},
           {file("huge.pfm", "PF\n20000 20000\n-1.0\n"), "the limit is 16384 on a side"}}) {
    SCOPED_TRACE(path);
    const Outcome outcome = candela({"render", path, out_});
    expect_error(outcome, 3, words);
    EXPECT_TRUE(says(outcome.err, path));
  }
}

TEST_F(Failure, AFolderOfImagesNeedsAFolderForThem) {
  expect_error(candela({"render", folder_.path(""), out_}), 2,
               out_ + " is one file; several images need a folder");
}

TEST_F(Failure, ABadPixelUnderRejectIsNamed) {
  std::string pfm = "PF\n2 1\n-1.0\n";
  const float pixels[] = {1, 1, 1, 1, __builtin_nanf(""), 1};
  pfm.append(reinterpret_cast<const char*>(pixels), sizeof pixels);
  const std::string path = file("nan.pfm", pfm);
  expect_error(candela({"render", path, out_, "--bad-values", "reject"}), 3, path);
  const nlohmann::json scrubbed = candela_json({"render", path, folder_.path("other.png")});
  EXPECT_EQ(scrubbed.at("bad_values").at("nan"), 1);
}

TEST_F(Failure, OutputsThatCannotBeWrittenAreKnownBeforeTheWork) {
  expect_error(candela({"render", in_, out_ + "/folder/out.png"}), 5, "cannot write");
  mkdir(folder_.path("a.json").c_str(), 0700);
  expect_error(candela({"render", in_, out_, "--json", folder_.path("a.json")}), 5, "Is a directory");
  expect_error(candela({"render", in_, out_, "--json", out_ + "/frame.json"}), 5, "cannot write");
  expect_error(candela({"sample", out_ + "/scene.exr"}), 5, "cannot write");
}

TEST_F(Failure, AnOutputThatIsAnInputIsRefused) {
  const std::string before = read_file(in_);
  const std::string link = folder_.path("link.exr"), hard = folder_.path("hard.exr"),
                    other_way = folder_.path("./in.exr");
  ASSERT_EQ(symlink("in.exr", link.c_str()), 0);
  ASSERT_EQ(::link(in_.c_str(), hard.c_str()), 0);
  expect_error(candela({"render", in_, in_}), 2, in_ + " is the input; write the image to another file");
  for (const std::string& same : {link, hard, other_way}) {
    expect_error(candela({"render", in_, same}), 2, same + " is the input, " + in_ + "; write the image");
    expect_error(candela({"render", same, in_}), 2, in_ + " is the input, " + same);
    expect_error(candela({"render", in_, out_, "--json", same}), 2, "write the JSON to another file");
    expect_error(candela({"meter", in_, "--json", same}), 2, "write the JSON to another file");
    expect_error(candela({"info", in_, "--json", same}), 2, "write the JSON to another file");
  }
  // Folders of outputs are made, so this path will lead to the input.
  expect_error(candela({"render", in_, folder_.path("new/../in.exr")}), 2, "is the input");
  expect_error(candela({"render", in_, folder_.path(""), "--as", "exr"}), 2, "is the input");
  expect_error(candela({"render", in_, folder_.path("new.png"), "--json", folder_.path("./new.png")}), 2,
               "the image and the JSON would be one file");
  expect_error(candela({"report", folder_.path(""), "--images", in_, file("index.html", "kept")}), 2,
               "is one of the inputs");
  EXPECT_TRUE(read_file(in_) == before);
}

TEST_F(Failure, MissingPartsLayersAndViewsListWhatThereIs) {
  for (const char* command : {"render", "meter"}) {
    std::vector<std::string> arguments{command, in_};
    if (command == std::string("render")) arguments.push_back(out_);
    const auto with = [&](const char* option, const char* name) {
      std::vector<std::string> all = arguments;
      all.insert(all.end(), {option, name});
      return candela(all);
    };
    expect_error(with("--part", "2"), 3, "there is no part \"2\"; there are: 1");
    expect_error(with("--layer", "depth"), 3, "there is no layer \"depth\"; there are: B, G, R");
    expect_error(with("--exr-view", "left"), 3, "there is no view \"left\"; the file names no views");
  }
  expect_error(candela({"stream", in_, folder_.path("%04d.png"), "--layer", "depth"}), 3,
               "there are: B, G, R");
}

TEST_F(Failure, AFileOfFewBytesAndManyPixelsTakesNoMemory) {
  // Each scan line is a pixel and its repetitions in two records: 8191 = 255 + 31 * 256.
  std::string hdr = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8192 +X 8192\n";
  for (int y = 0; y < 8192; ++y) hdr.append("\x80\x80\x80\x80\x01\x01\x01\xff\x01\x01\x01\x1f", 12);
  const Outcome outcome = candela({"render", file("bomb.hdr", hdr), out_});
  expect_error(outcome, 3, "save it as half floats or smaller");
  EXPECT_LT(outcome.peak_kib, 600'000);
}

#ifndef CANDELA_SANITIZED  // a sanitizer wants to be loaded first
TEST_F(Failure, ADiskThatLosesThePictureIsAnError) {
  const std::string scene = file("scene.exr", "old");
  expect_error(candela_on_failing_machine("CANDELA_TEST_FSYNC_FAILS", "1", {"sample", scene, "-q"}), 5,
               "scene.exr: cannot write: Input/output error");
  EXPECT_TRUE(read_file(scene) == "old");
}
#endif

TEST_F(Failure, WhatStdoutCannotTakeIsAnError) {
  expect_error(candela({"render", in_, folder_.path("other.png"), "-q", "--json", "/dev/full"}), 5,
               "No space left");
}

TEST_F(Failure, UnknownDevicesAndTiersListWhatThereIs) {
  expect_error(candela({"render", in_, out_, "--device", "no such device"}), 4, "there are: ");
  expect_error(candela({"render", in_, out_, "--tier", "standrd"}), 2, "did you mean standard?");
}

TEST_F(Failure, AServerThatIsNotThereIsNamed) {
  const std::string address = "unix:" + folder_.path("socket");
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"render", in_, out_, "--server", address},
                                             {"info", "--server", address},
                                             {"health", "--server", address, "--timeout", "2"}}) {
    expect_error(candela(arguments), arguments[0] == "health" ? 1 : 4, "cannot reach " + address);
  }
}

TEST_F(Failure, ALineEndInANameDoesNotMakeTwoLines) {
  expect_error(candela({"render", folder_.path("a\nb.exr"), out_}), 3, "a\\nb.exr");
}

TEST_F(Failure, ASignalLeavesNoHiddenFile) {
  const std::string scene = folder_.path("scene.exr"), picture = folder_.path("picture.png");
  ASSERT_EQ(candela({"sample", scene, "--size", "1200x900", "-q"}).code, 0);
  const std::vector<std::string> arguments{"render", scene, picture,  "--bits",
                                           "16",     "-q",  "--json", folder_.path("frame.json")};
  for (const int ms : {20, 60, 100, 150, 200, 250, 300, 350, 400}) {
    write_file(picture, "old");
    const int signal = ms % 100 == 0 ? SIGTERM : SIGINT;
    const Outcome outcome = candela_with_signal(arguments, signal, ms);
    EXPECT_TRUE(outcome.code == 0 || outcome.code == 128 + signal) << outcome.code;
    for (const std::string& name : folder_.list()) {
      EXPECT_FALSE(says(name, ".part")) << " after " << ms << " ms";
    }
    const std::string bytes = read_file(picture);
    EXPECT_TRUE((bytes == "old" && outcome.code != 0) || bytes.find("IEND") + 8 == bytes.size())
        << bytes.size() << " bytes";
  }
}

}  // namespace
}  // namespace candela
