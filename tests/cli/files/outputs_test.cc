// Outputs that are inputs: every command refuses them under every name, before any work, and leaves nothing.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class Outputs : public ::testing::Test {
 protected:
  void SetUp() override {
    write_small_exr(in_);
    for (const char* name : {"file.txt", "token", "shot.json"}) write_file(folder_.path(name), "kept");
  }

  // All names of one file: as it is, by another spelling, by links, and through a folder that is not there.
  std::vector<std::string> names_of(const std::string& name) const {
    const std::string path = folder_.path(name);
    const std::string soft = folder_.path("soft_" + name), hard = folder_.path("hard_" + name);
    (void)symlink(path.c_str(), soft.c_str());
    (void)::link(path.c_str(), hard.c_str());
    return {path, folder_.path("./" + name), soft, hard, folder_.path("none/../" + name)};
  }

  void expect_refused(const std::vector<std::string>& arguments) const {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    const std::vector<std::string> before = folder_.list();
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(outcome.err.find("to another file") != std::string::npos ||
                outcome.err.find("would be one file") != std::string::npos)
        << outcome.err;
    EXPECT_EQ(folder_.list(), before);
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string out_ = folder_.path("out.png");
};

TEST_F(Outputs, FilesOfTheServersOptionsAreInputsOfEveryCommand) {
  const std::string folder = folder_.path("out");
  const std::vector<std::vector<std::string>> commands = {{"render", in_, out_},
                                                          {"stream", in_, folder},
                                                          {"meter", in_},
                                                          {"info", in_},
                                                          {"bench"},
                                                          {"view", in_, out_},
                                                          {"environment", in_, folder_.path("sky.ktx2")}};
  for (const std::string& json : names_of("token")) {
    for (const std::vector<std::string>& command : commands) {
      for (const char* option : {"--token-file", "--tls-ca", "--tls-cert", "--tls-key"}) {
        std::vector<std::string> arguments = command;
        arguments.insert(arguments.end(),
                         {"--server", "127.0.0.1:1", option, folder_.path("token"), "--json", json});
        expect_refused(arguments);
      }
    }
  }
  write_file(folder_.path("report.json"), "kept");
  expect_refused(
      {"report", folder_.path("."), "--server", "127.0.0.1:1", "--token-file", folder_.path("report.json")});
  EXPECT_EQ(read_file(folder_.path("token")), "kept");
  EXPECT_EQ(read_file(folder_.path("report.json")), "kept");
}

TEST_F(Outputs, EveryOutputOfASequenceIsHeldAgainstItsInputs) {
  for (const char* option : {"--json", "--save-exposures"}) {
    for (const std::string& input : names_of("in.exr")) {
      expect_refused({"stream", in_, folder_.path("out"), option, input});
      expect_refused({"meter", folder_.path("*.exr"), option, input});
    }
  }
  for (const std::string& same : names_of("file.txt")) {
    expect_refused({"stream", in_, folder_.path("out"), "--ocio", folder_.path("file.txt"), "--json", same});
    expect_refused({"render", in_, out_, "--ocio", folder_.path("file.txt"), "--json", same});
    expect_refused({"render", in_, out_, "--locked-exposure", folder_.path("file.txt"), "--json", same});
    expect_refused(
        {"stream", in_, folder_.path("out"), "--save-exposures", folder_.path("file.txt"), "--json", same});
  }
  expect_refused({"stream", in_, folder_.path("%04d.exr"), "--save-exposures", folder_.path("0000.exr")});
  const std::string plot = folder_.path("plot.svg");  // the name has to end so
  for (const auto link_as : {&symlink, &::link}) {
    ASSERT_EQ(link_as(in_.c_str(), plot.c_str()), 0);
    expect_refused({"stream", in_, folder_.path("out"), "--exposure-plot", plot});
    expect_refused({"meter", in_, "--exposure-plot", plot});
    expect_refused(
        {"view", in_, folder_.path("%04d.png"), "--turn", "90", "--frames", "2", "--exposure-plot", plot});
    ASSERT_EQ(unlink(plot.c_str()), 0);
  }
}

TEST_F(Outputs, OfAViewAreHeldAgainstItsInputs) {
  write_file(folder_.path("keys.json"),
             R"({"keys": [{"time": 0, "yaw": 0, "fov": 60}, {"time": 1, "yaw": 90, "fov": 60}]})");
  write_file(folder_.path("spheres.json"), R"({"objects": [{"centre": [0, 0, -3], "radius": 1}]})");
  const std::string frames = folder_.path("frames/%04d.png");
  for (const std::string& same : names_of("in.exr")) {
    expect_refused({"view", in_, same});
    expect_refused({"view", same, in_});
    expect_refused({"view", in_, out_, "--json", same});
    expect_refused({"view", in_, frames, "--turn", "90", "--frames", "2", "--json", same});
  }
  for (const auto& [option, name] : std::vector<std::pair<std::string, std::string>>{
           {"--objects", "spheres.json"}, {"--ocio", "file.txt"}, {"--locked-exposure", "shot.json"}}) {
    for (const std::string& same : names_of(name)) {
      expect_refused({"view", in_, out_, option, folder_.path(name), "--json", same});
      expect_refused(
          {"view", in_, frames, "--turn", "90", "--frames", "2", option, folder_.path(name), "--json", same});
    }
  }
  for (const std::string& same : names_of("keys.json")) {
    expect_refused(
        {"view", in_, frames, "--path", folder_.path("keys.json"), "--frames", "2", "--json", same});
  }
  for (const auto link_as : {&symlink, &::link}) {
    ASSERT_EQ(link_as(in_.c_str(), out_.c_str()), 0);
    expect_refused({"view", in_, out_});
    expect_refused({"view", in_, folder_.path("other.png"), "--error-map", out_});
    ASSERT_EQ(unlink(out_.c_str()), 0);
    ASSERT_EQ(link_as(in_.c_str(), folder_.path("0001.png").c_str()), 0);
    expect_refused({"view", in_, folder_.path("%04d.png"), "--turn", "90", "--frames", "2"});
    ASSERT_EQ(unlink(folder_.path("0001.png").c_str()), 0);
  }
}

TEST_F(Outputs, OfAnEnvironmentAreHeldAgainstItsInputs) {
  const std::string sky = folder_.path("sky.ktx2");
  for (const std::string& same : names_of("in.exr")) {
    expect_refused({"environment", in_, same});
    expect_refused({"environment", same, in_});
    expect_refused({"environment", in_, sky, "--json", same});
  }
  // Outputs whose names have to end in something else.
  const std::string map = folder_.path("link.ktx2"), sh = folder_.path("sh.json"),
                    preview = folder_.path("preview.png"), faces = folder_.path("faces/");
  std::filesystem::create_directories(faces + "level1");
  const std::vector<std::pair<std::string, std::vector<std::string>>> links = {
      {map, {"environment", in_, map}},
      {sh, {"environment", in_, sky, "--sh", sh}},
      {preview, {"environment", in_, sky, "--preview", preview}},
      {folder_.path("cube.level1.exr"), {"environment", in_, folder_.path("cube.exr"), "--levels", "2"}},
      {faces + "nz.exr", {"environment", in_, faces}},
      {faces + "level1/px.exr", {"environment", in_, faces}}};
  for (const auto link_as : {&symlink, &::link}) {
    for (const auto& [link, arguments] : links) {
      ASSERT_EQ(link_as(in_.c_str(), link.c_str()), 0);
      expect_refused(arguments);
      ASSERT_EQ(unlink(link.c_str()), 0);
    }
  }
}

// The folder of a file to save is made only once the command is found to be right.
TEST_F(Outputs, NothingIsMadeForACommandThatIsRefused) {
  expect_refused({"stream", in_, folder_.path("out"), "--save-exposures", folder_.path("new/saved.json"),
                  "--json", in_});
  const std::vector<std::string> made = folder_.list();
  EXPECT_FALSE(std::count(made.begin(), made.end(), "new"));
}

TEST_F(Outputs, ACommandThatFailsRemovesTheFoldersThatItMade) {
  write_file(folder_.path("damaged.exr"), "v/1\1");
  const std::string image = folder_.path("new/deep/out.png");
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"render", folder_.path("damaged.exr"), image},
        {"view", folder_.path("damaged.exr"), image},
        {"environment", folder_.path("damaged.exr"), folder_.path("new/deep/")}}) {
    const std::vector<std::string> before = folder_.list();
    EXPECT_EQ(candela(arguments).code, 3);
    EXPECT_EQ(folder_.list(), before);
  }
  ASSERT_TRUE(std::filesystem::create_directory(folder_.path("new")));
  EXPECT_EQ(candela({"render", folder_.path("damaged.exr"), image}).code, 3);
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path("new")));
}

TEST_F(Outputs, FieldsOfTheContractAreNamedAsOptions) {
  struct Case {
    std::vector<std::string> arguments;
    int code;
    std::string words;
  };
  const std::string folder = folder_.path("out");
  for (const auto& [arguments, code, words] : std::vector<Case>{
           {{"render", in_, out_, "--spot", "900,0,910,10"}, 2, in_ + ": --spot begins at x 900"},
           {{"render", in_, out_, "--spot", "4,4,4,8"}, 2, "--spot is x 4 .. 4"},
           {{"meter", in_, "--spot", "900,0,910,10"}, 2, "--spot begins at x 900"},
           {{"stream", in_, folder, "--spot", "900,0,910,10"}, 2, "--spot begins at x 900"},
           {{"stream", in_, folder, "--session", "a/b"}, 2, "--session has 3 bytes"},
           {{"stream", in_, folder, "--encoding", "jpeg", "--alpha", "straight"}, 2, "--alpha is STRAIGHT"},
           {{"render", in_, out_, "--primaries", "0.3,0.3,0.3,0.3,0.1,0.1,0.3,0.3"},
            2,
            "--primaries (0.3"}}) {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  }
}

}  // namespace
}  // namespace candela
