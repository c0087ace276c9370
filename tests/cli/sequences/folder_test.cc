// `candela render` of many images into a folder.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <csignal>
#include <filesystem>

#include "absl/strings/str_split.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class Folder : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(mkdir(folder_.path("in").c_str(), 0700), 0);
    for (const char* name : {"b2.exr", "b10.exr", "a.exr"}) write_small_exr(in(name), name[0] == 'a');
  }
  std::string in(const std::string& name) const { return folder_.path("in/" + name); }
  std::string out(const std::string& name) const { return folder_.path("out/new/" + name); }
  // Pictures that the command may replace.
  static constexpr const char* kOldPictures[] = {"a.png", "b2.png", "scene.exr"};
  void write_old_pictures() const {
    std::filesystem::create_directories(folder_.path("out/new"));
    for (const char* name : kOldPictures) write_file(out(name), "old");
  }
  // Each file is whole, or as write_old_pictures() made it. If the command ended with 0, `written` is not.
  void expect_whole_pictures(int code, const std::string& written, int signal = SIGINT) const {
    EXPECT_TRUE(code == 128 + signal || (code == 0 && read_file(written) != "old")) << code;
    for (const auto& file : std::filesystem::directory_iterator(folder_.path("out/new"))) {
      SCOPED_TRACE(file.path());
      const std::string bytes = read_file(file.path());
      if (bytes == "old") continue;
      if (file.path().extension() == ".exr") {
        EXPECT_OK(read_image(file.path()));
      } else {
        EXPECT_EQ(file.path().extension(), ".png");
        EXPECT_EQ(bytes.substr(0, 4), "\x89PNG");
        EXPECT_EQ(bytes.substr(std::max<size_t>(bytes.size(), 8) - 8, 4), "IEND");
      }
    }
    for (const char* name : kOldPictures) {
      EXPECT_TRUE(std::filesystem::exists(out(name))) << name;
    }
  }
  // The lines of JSON on stdout.
  static std::vector<nlohmann::json> lines(const Outcome& outcome) {
    std::vector<nlohmann::json> all;
    for (absl::string_view line : absl::StrSplit(outcome.out, '\n', absl::SkipEmpty())) {
      all.push_back(nlohmann::json::parse(line, nullptr, false));
    }
    return all;
  }

  const TemporaryFolder folder_;
};

TEST_F(Folder, EveryImageIsTheOneThatItIsAlone) {
  const Outcome outcome = candela({"render", in("b10.exr"), in("a.exr"), in("b2.exr"), out("")});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  for (const char* name : {"a", "b2", "b10"}) {
    const std::string alone = folder_.path("alone.png"), input = in(name) + ".exr";
    ASSERT_EQ(candela({"render", input, alone, "-q"}).code, 0);
    EXPECT_TRUE(read_file(alone) == read_file(out(name) + ".png")) << name;
  }
  // The lines are in the order of the inputs.
  const std::vector<std::string> text = absl::StrSplit(outcome.out, '\n', absl::SkipEmpty());
  ASSERT_EQ(text.size(), 4u) << outcome.out;
  EXPECT_EQ(text[0].find(in("b10.exr") + " -> "), 0u) << text[0];
  EXPECT_EQ(text[1].find(in("a.exr") + " -> "), 0u) << text[1];
  EXPECT_EQ(text[3].find("3 of 3 images -> "), 0u) << text[3];
}

TEST_F(Folder, APatternAndAFolderAreTakenInNaturalOrder) {
  for (const std::string& input : {in("*.exr"), folder_.path("in")}) {
    const Outcome outcome = candela({"render", input, out(""), "--as", "exr", "--json", "-"});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const std::vector<nlohmann::json> all = lines(outcome);
    ASSERT_EQ(all.size(), 4u) << outcome.out;
    for (size_t i = 0; i < 3; ++i) {
      const std::string name = std::vector<std::string>{"a", "b2", "b10"}[i];
      EXPECT_EQ(all[i].at("input"), in(name + ".exr"));
      EXPECT_EQ(all[i].at("output"), out(name + ".exr"));
      EXPECT_EQ(all[i].at("size").at("width"), 31);
      EXPECT_OK(read_image(out(name + ".exr")));
    }
    EXPECT_EQ(all[3].at("summary").at("images"), 3);
    EXPECT_EQ(all[3].at("summary").at("written"), 3);
    EXPECT_EQ(all[3].at("summary").at("failed"), 0);
  }
}

TEST_F(Folder, OneImageKeepsItsNameInAFolder) {
  EXPECT_EQ(candela({"render", in("a.exr"), out(""), "-q"}).code, 0);
  EXPECT_EQ(png_facts(out("a.png")).width, 31u);
  EXPECT_EQ(candela({"render", in("b2.exr"), folder_.path("out/new"), "-q", "--as", "jpg"}).code, 0);
  EXPECT_EQ(read_file(out("b2.jpg")).substr(0, 2), "\xff\xd8");
}

TEST_F(Folder, OneFailureDoesNotStopTheRest) {
  write_file(in("b1.exr"), "no image");
  const Outcome outcome = candela({"render", in("*.exr"), in("missing.exr"), out(""), "--json", "-"});
  EXPECT_EQ(outcome.code, 3);
  const std::vector<std::string> errors = absl::StrSplit(outcome.err, '\n', absl::SkipEmpty());
  const auto is_error = [&](const std::string& words) {
    return std::ranges::any_of(errors, [&](const std::string& line) {
      return line.find("candela: error: ") == 0 && line.find(words) != std::string::npos;
    });
  };
  EXPECT_TRUE(is_error(in("b1.exr") + ": not an OpenEXR")) << outcome.err;
  EXPECT_TRUE(is_error(in("missing.exr") + ": cannot read")) << outcome.err;
  EXPECT_EQ(errors.back(), "candela: error: 2 of 5 images failed");
  for (const char* name : {"a.png", "b2.png", "b10.png"}) EXPECT_EQ(png_facts(out(name)).width, 31u) << name;
  const std::vector<nlohmann::json> all = lines(outcome);
  ASSERT_EQ(all.size(), 6u) << outcome.out;
  EXPECT_TRUE(says(all[1].at("error").get<std::string>(), "not an OpenEXR"));
  EXPECT_EQ(all[5].at("summary").at("failed"), 2);
}

TEST_F(Folder, TwoImagesOfOneNameAreRefusedBeforeAnythingIsRendered) {
  ASSERT_EQ(candela({"sample", in("a.pfm"), "--size", "8x8", "-q"}).code, 0);
  const Outcome outcome = candela({"render", in("b2.exr"), in("a.exr"), in("a.pfm"), out("")});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(says(outcome.err, "a.exr and " + in("a.pfm") + " would both become " + out("a.png")));
  struct stat about {};
  EXPECT_NE(stat(out("").c_str(), &about), 0);
}

TEST_F(Folder, AServerThatIsNotThereIsOneError) {
  const Outcome outcome =
      candela({"render", in("*.exr"), out(""), "--server", "unix:" + folder_.path("none")});
  EXPECT_EQ(outcome.code, 4);
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  EXPECT_TRUE(says(outcome.err, "cannot reach"));
}

TEST_F(Folder, ASignalLeavesNoPartOfAFile) {
  for (const char* name : {"c1.exr", "c2.exr", "c3.exr", "c4.exr"}) {
    ASSERT_EQ(candela({"sample", in(name), "--size", "900x600", "-q"}).code, 0);
  }
  for (const int ms : {150, 300, 450, 600}) {
    SCOPED_TRACE(ms);
    write_old_pictures();
    const Outcome outcome = candela_with_signal({"render", in("*.exr"), out(""), "-q"}, SIGINT, ms);
    expect_whole_pictures(outcome.code, out("a.png"));
  }
}

#ifndef CANDELA_SANITIZED  // a sanitizer wants to be loaded first
TEST_F(Folder, ASignalWhileAFileIsMadeLeavesNoPartOfIt) {
  // More images than writers, so that a writer begins another while the process ends.
  for (int i = 0; i < 8; ++i) write_small_exr(in("c" + std::to_string(i) + ".exr"), false);
  const std::string signal = std::to_string(SIGINT);
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"render", in("*.exr"), out(""), "-q"},
                                             {"render", in("a.exr"), out("a.png"), "-q"},
                                             {"sample", out("scene.exr"), "-q"}}) {
    for (const char* variable : {"CANDELA_TEST_SIGNAL", "CANDELA_TEST_FIRST_PROCESS"}) {
      SCOPED_TRACE(arguments[0] + " " + variable);
      write_old_pictures();
      const Outcome outcome = candela_on_failing_machine(variable, signal.c_str(), arguments);
      EXPECT_EQ(outcome.err, "");
      expect_whole_pictures(outcome.code, out(arguments[0] == "sample" ? "scene.exr" : "a.png"));
    }
  }
  for (const int each : {SIGTERM, SIGHUP, SIGQUIT, SIGABRT, SIGALRM, SIGUSR1, SIGUSR2, SIGXCPU}) {
    SCOPED_TRACE(each);
    write_old_pictures();
    const Outcome outcome = candela_on_failing_machine("CANDELA_TEST_SIGNAL", std::to_string(each).c_str(),
                                                       {"render", in("a.exr"), out("a.png"), "-q"});
    EXPECT_EQ(outcome.err, "");
    expect_whole_pictures(outcome.code, out("a.png"), each);
  }
}
#endif

TEST_F(Folder, FoldersOfOutputsAreMade) {
  const std::string json_file = folder_.path("x/y/z.json"), map = folder_.path("maps/m/map.png");
  ASSERT_EQ(
      candela({"render", in("a.exr"), folder_.path("p/q/a.png"), "--json", json_file, "--error-map", map})
          .code,
      0);
  EXPECT_EQ(png_facts(folder_.path("p/q/a.png")).width, 31u);
  EXPECT_TRUE(nlohmann::json::parse(read_file(json_file), nullptr, false).is_object());
  EXPECT_GT(png_facts(map).width, 0u);
  EXPECT_EQ(candela({"sample", folder_.path("s/t/scene.exr"), "--size", "8x8", "-q"}).code, 0);
  EXPECT_OK(read_image(folder_.path("s/t/scene.exr")));
}

}  // namespace
}  // namespace candela
