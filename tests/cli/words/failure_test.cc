// How a command ends that fails: its exit code says in what way (docs/failures.md), and its JSON says it in a
// line.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

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

}  // namespace
}  // namespace candela
