// Names, notes and help: what the command understands, suggests and says.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class Words : public ::testing::Test {
 protected:
  void SetUp() override { write_small_exr(in_); }

  Outcome render(std::vector<std::string> options, const std::string& out = "out.png") const {
    options.insert(options.begin(), {"render", in_, folder_.path(out)});
    return candela(options);
  }
  std::string image(const std::vector<std::string>& options) const {
    const Outcome outcome = render(options);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return read_file(folder_.path("out.png"));
  }
  // The notes of a render with these options, and with no others.
  std::string notes(const std::vector<std::string>& options, const std::string& out = "out.png") const {
    const Outcome outcome = render(options, out);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return outcome.err;
  }
  void refuses(const std::vector<std::string>& options, const std::string& words) const {
    const Outcome outcome = render(options);
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
};

TEST_F(Words, PrimariesHaveTheNamesByWhichPeopleKnowThem) {
  for (const auto& [name, own] : std::vector<std::pair<std::string, std::string>>{{"acescg", "aces-ap1"},
                                                                                  {"ACEScg", "aces-ap1"},
                                                                                  {"ap1", "aces-ap1"},
                                                                                  {"aces2065-1", "aces-ap0"},
                                                                                  {"AP0", "aces-ap0"},
                                                                                  {"display-p3", "p3-d65"},
                                                                                  {"Display P3", "p3-d65"},
                                                                                  {"srgb", "rec709"},
                                                                                  {"linear-srgb", "rec709"},
                                                                                  {"rec.709", "rec709"},
                                                                                  {"BT2020", "rec2020"},
                                                                                  {"BT.2020", "rec2020"}}) {
    EXPECT_EQ(image({"--primaries", name}), image({"--primaries", own})) << name;
  }
  EXPECT_NE(image({"--primaries", "acescg"}), image({"--primaries", "rec709"}));
  EXPECT_TRUE(says(candela({"render", "--help"}).out, "aces-ap1 (acescg, ap1)"));
}

TEST_F(Words, NamesDoNotDependOnCase) {
  EXPECT_EQ(image({"--curve", "ACES-1"}), image({"--curve", "aces-1"}));
  EXPECT_EQ(image({"--exposure", "AUTO"}), image({}));
  EXPECT_EQ(image({"--bloom-firefly", "OFF"}), image({"--bloom-firefly", "off"}));
  EXPECT_EQ(image({"--tier", "Draft"}), image({"--tier", "draft"}));
  EXPECT_EQ(image({"--bloom", "Gaussian", "--bad-values", "SCRUB"}), image({"--bloom", "gaussian"}));
}

TEST_F(Words, NearNamesAreSuggested) {
  refuses({"--curve", "aces"}, "unknown curve \"aces\"; did you mean aces-narkowicz, aces-hill, aces-1 or aces-2?");
  refuses({"--primaries", "acescgg"}, "did you mean acescg?");
  refuses({"--primaries", "p3"}, "did you mean p3-d65?");
  refuses({"--primaries", "adobe"},
          "unknown primaries \"adobe\"; there are: rec709 (srgb, linear-srgb, bt709)");
  refuses({"--tier", "STANDART"}, "did you mean standard?");
  for (const char* off : {"none", "off", "Off", "no"}) {
    refuses({"--bloom", off}, "--bloom-intensity 0 turns bloom off");
  }
  refuses({"--transfer", "none"}, "linear writes light as it is");
}

TEST_F(Words, AnOptionIsNoValue) {
  refuses({"--json", "--quiet"},
          "--json needs a value, FILE|-, but --quiet is an option; write --json - for stdout");
  refuses({"--json", "-q"}, "but -q is an option");
  refuses({"--json"}, "--json needs a value");
  for (const char* name :
       {"--error-map", "--ocio", "--display", "--ocio-view", "--exr-view", "--ocio-input", "--server",
        "--tls-ca", "--token-file", "--device", "--curve", "--exposure", "--spot"}) {
    refuses({name, "--quiet"}, std::string(name) + " needs a value");
  }
  for (const char* name : {"--exposure-plot", "--json", "--session"}) {
    const Outcome stream = candela({"stream", in_, folder_.path("out_%d.png"), name, "--quiet"});
    EXPECT_EQ(stream.code, 2);
    EXPECT_TRUE(says(stream.err, std::string(name) + " needs a value"));
  }
  // A name like that can still be meant, and a number is none.
  const std::string odd = folder_.path("--quiet");
  EXPECT_EQ(render({"--exposure", "-2", "--json=" + odd, "-q"}).code, 0);
  EXPECT_TRUE(says(read_file(odd), "\"exposure\""));
}

// A script whose variable is empty must not turn an option off.
TEST_F(Words, AnEmptyValueIsNone) {
  for (const std::string name :
       {"--server", "--tls-ca", "--token-file", "--device", "--json", "--error-map", "--ocio", "--display",
        "--locked-exposure", "--layer", "--curve", "--exposure", "--key", "--bits", "--resume"}) {
    const std::string words = name + " is empty; leave it out or give it a value";
    refuses({name, ""}, words);
    refuses({name + "=", "-q"}, words);
  }
  for (const std::string name : {"--exposure-plot", "--save-exposures", "--session", "--range"}) {
    const Outcome stream = candela({"stream", in_, folder_.path("out_%d.png"), name, ""});
    EXPECT_EQ(stream.code, 2);
    EXPECT_TRUE(says(stream.err, name + " is empty"));
  }
  for (const std::string name : {"--objects", "--path"}) {
    const Outcome view = candela({"view", in_, folder_.path("out.png"), name, ""});
    EXPECT_EQ(view.code, 2);
    EXPECT_TRUE(says(view.err, name + " is empty"));
  }
  // A number of --detect-cuts is optional, and an empty variable is as good as none.
  EXPECT_EQ(candela({"stream", in_, folder_.path("out_%d.png"), "-q", "--detect-cuts="}).code, 0);
  const std::vector<const char*> variables = {"CANDELA_SERVER", "CANDELA_CLIENT_TLS_CA",
                                              "CANDELA_CLIENT_TOKEN_FILE"};
  for (const char* variable : variables) setenv(variable, "", 1);
  EXPECT_EQ(notes({}), "");
  for (const char* variable : variables) unsetenv(variable);
}

TEST_F(Words, OptionsThatChangeNothingAreNamed) {
  struct Case {
    std::vector<std::string> options;
    std::vector<std::string> idle;
    std::string because;
    std::string out = "out.png";
  };
  for (const auto& [options, idle, because, out] : std::vector<Case>{
           {{"--curve-white", "8"}, {"--curve-white"}, "only --curve reinhard-extended uses it"},
           {{"--exposure", "1", "--compensation", "1", "--key", "1", "--min-exposure", "1", "--max-exposure",
             "2", "--speed-up", "1", "--metering", "percentile", "--ignore-below", "0.1"},
            {"--compensation", "--key", "--min-exposure", "--max-exposure", "--speed-up", "--metering",
             "--ignore-below"},
            "--exposure fixes the exposure"},
           {{"--percentiles", "5,95", "--metering", "log-average"}, {"--metering"}, "--percentiles asks"},
           {{"--spot", "0,0,2,2", "--weights=average"}, {"--weights"}, "--spot asks"},
           {{"--speed-up", "1", "--adaptation", "log"},
            {"--speed-up", "--adaptation"},
            "--previous-exposure"},
           {{"--speed-up", "1", "--previous-exposure", "1"}, {"--speed-up"}, "give --elapsed SECONDS"},
           {{"--bloom-intensity", "0", "--bloom", "mip", "--bloom-levels", "3"},
            {"--bloom", "--bloom-levels"},
            "--bloom-intensity 0 turns bloom off"},
           {{"--bloom", "conserve", "--bloom-threshold", "2", "--bloom-softness", "0"},
            {"--bloom-threshold", "--bloom-softness"},
            "--bloom conserve spreads all light"},
           {{"--bloom", "gaussian", "--bloom-levels", "2"},
            {"--bloom-levels"},
            "--bloom gaussian does not use it"},
           {{"--transfer", "srgb", "--dither"}, {"--transfer", "--dither"}, ".exr and .pfm files", "out.exr"},
           {{"--bits", "8"}, {"--bits"}, "no choice of bits", "out.jpg"},
           {{"--tls", "--tls-name", "a"}, {"--tls", "--tls-name"}, "built into this process"}}) {
    SCOPED_TRACE(::testing::PrintToString(options));
    const std::string err = notes(options, out);
    for (const std::string& option : idle) {
      EXPECT_TRUE(says(err, "note: " + option + " changes nothing")) << option;
    }
    EXPECT_TRUE(says(err, because));
    EXPECT_EQ(std::count(err.begin(), err.end(), '\n'), static_cast<long>(idle.size())) << err;
  }
}

TEST_F(Words, OptionsThatMatterAreNot) {
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {},
           {"--curve", "reinhard-extended", "--curve-white", "8"},
           {"--compensation", "1", "--key", "0.2", "--metering", "percentile", "--percentiles", "1,99"},
           {"--previous-exposure", "1", "--elapsed", "1", "--speed-up", "1"},
           {"--exposure", "1", "--bloom", "gaussian", "--weights", "center"},
           {"--bloom-threshold", "2", "--bloom-softness", "0", "--bloom-levels", "2"},
           {"--metering", "Percentile", "--percentiles", "1,99", "--weights", "spot", "--spot", "0,0,2,2"},
           {"--transfer", "linear", "--dither", "--bits", "8"}}) {
    EXPECT_EQ(notes(options), "") << ::testing::PrintToString(options);
  }
  EXPECT_EQ(notes({"--curve-white", "8", "-q"}), "");
}

TEST_F(Words, MeterStreamAndManyImagesNameThemToo) {
  const std::string folder = folder_.path("images/");
  write_small_exr(folder_.path("other.exr"));
  const Outcome many = candela({"render", in_, folder_.path("other.exr"), folder, "--as", "exr", "--dither"});
  EXPECT_TRUE(says(many.err, "--dither changes nothing: .exr and .pfm files hold floats"));
  EXPECT_EQ(many.code, 0);
  const Outcome meter = candela({"meter", in_, "--exposure", "1", "--key", "1"});
  EXPECT_EQ(meter.code, 0);
  EXPECT_TRUE(says(meter.err, "note: --key changes nothing"));
  const Outcome stream =
      candela({"stream", in_, folder_.path("o_%d.png"), "--exposure", "1", "--lookahead", "1"});
  EXPECT_EQ(stream.code, 0);
  EXPECT_TRUE(says(stream.err, "note: --lookahead changes nothing"));
}

TEST_F(Words, AVariableThatNothingReadsIsNamed) {
  setenv("CANDELA_SEVER", "a:1", 1);
  const std::string err = notes({});
  const std::string quiet = notes({"-q"});
  unsetenv("CANDELA_SEVER");
  EXPECT_EQ(err, "note: nothing reads the variable CANDELA_SEVER; did you mean CANDELA_SERVER?\n");
  EXPECT_EQ(quiet, "");
}

TEST_F(Words, HelpIsACommandToo) {
  EXPECT_EQ(candela({"help"}).out, candela({"--help"}).out);
  for (const char* command : {"render", "contact", "stream", "meter", "view", "environment", "sample",
                              "report", "bench", "info", "health"}) {
    const Outcome outcome = candela({"help", command});
    EXPECT_EQ(outcome.code, 0);
    EXPECT_EQ(outcome.out, candela({command, "--help"}).out);
    EXPECT_TRUE(says(outcome.out, std::string("Examples:\n  candela ") + command));
  }
  const Outcome unknown = candela({"help", "rendr"});
  EXPECT_EQ(unknown.code, 2);
  EXPECT_TRUE(says(unknown.err, "unknown command \"rendr\"; did you mean render?"));
}

// One white pixel of a file that says that its primaries are AP1's. --ocio-input says what its values are, so
// it is not converted by both.
TEST_F(Words, AFileIsNotConvertedTwice) {
  const std::string wide = folder_.path("wide.hdr");
  write_file(
      wide,
      "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nPRIMARIES=0.713 0.293 0.165 0.83 0.128 0.044 0.32168 0.33767\n\n"
      "-Y 1 +X 1\n\x80\x60\x40\x81");
  const std::string config = folder_.path("config.ocio");
  write_file(config,
             "ocio_profile_version: 2\nroles: {default: AP1, scene_linear: AP1}\n"
             "displays: {Screen: [!<View> {name: Plain, colorspace: AP1}]}\n"
             "colorspaces: [!<ColorSpace> {name: AP1}]\n");
  const std::string out = folder_.path("out.png");
  const auto run = [&](std::vector<std::string> options) {
    options.insert(options.end(), {"--ocio", config, "-q"});
    return candela(options);
  };
  const auto picture = [&](std::vector<std::string> options) {
    options.insert(options.begin(), {"render", wide, out});
    const Outcome outcome = run(options);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return read_file(out);
  };
  const std::string own = picture({"--ocio-input", "AP1"});
  EXPECT_EQ(picture({"--ocio-input", "AP1", "--primaries", "rec709"}), own);
  EXPECT_NE(picture({}), own);
  const Outcome streamed = run({"stream", wide, folder_.path("o_%d.png"), "--ocio-input", "AP1"});
  EXPECT_EQ(streamed.code, 0) << streamed.err;
  for (const char* primaries : {"acescg", "0.7,0.3,0.2,0.7,0.1,0.1,0.3,0.3"}) {
    const Outcome refused = run({"render", wide, out, "--ocio-input", "AP1", "--primaries", primaries});
    EXPECT_EQ(refused.code, 2) << refused.err;
    EXPECT_TRUE(says(refused.err, "--primaries and --ocio-input AP1 both say what the file's values are"));
  }
  const Outcome plain = run({"render", in_, out, "--ocio-input", "AP1"});
  EXPECT_EQ(plain.code, 0) << plain.err;
}

}  // namespace
}  // namespace candela
