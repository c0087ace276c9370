// Names, notes and help: what the command understands, suggests and says.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/daemon.h"
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
  refuses({"--curve", "aces"},
          "unknown curve \"aces\"; did you mean aces-narkowicz, aces-hill, aces-1 or aces-2?");
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

// Slips that people make at a shell: each gets one line that says what is wrong and what to write instead.

class Slips : public ::testing::Test {
 protected:
  void SetUp() override { write_small_exr(in_); }

  void expect_line(const std::vector<std::string>& arguments, int code, const std::string& words) const {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  }
  void expect_note(const std::vector<std::string>& arguments, const std::string& words) const {
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  }
  std::vector<std::string> render(std::vector<std::string> options) const {
    options.insert(options.begin(), {"render", in_, out_});
    return options;
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string out_ = folder_.path("out.png");
};

TEST_F(Slips, ANumberWithAUnitOrACommaIsShownWithout) {
  expect_line(render({"--white-balance", "6500K"}), 2, "; write 6500, without a unit");
  expect_line(render({"--exposure", "-2EV"}), 2, "; write -2, without a unit");
  expect_line(render({"--exposure", "1,5"}), 2, "; write 1.5, with a point");
  expect_line(render({"--key", "18%"}), 2, "; write a number without a unit, in the unit that --help names");
  expect_line(render({"--elapsed", "40ms"}), 2, "; write a number without a unit, in the unit that --help");
  expect_line({"view", in_, out_, "--fov", "60deg"}, 2, "; write 60, without a unit");
  expect_line(render({"--exposure", "much"}), 2, "it must be -40 .. 40, or auto\n");
}

TEST_F(Slips, AnOptionForJsonReplacesNothingElse) {
  const std::string image = read_file(in_), notes = folder_.path("notes.txt"), json = folder_.path("a.json");
  write_file(notes, "mine\n");
  write_file(json, "{\"old\": 1}\n");
  expect_line({"info", "--json", in_}, 2,
              "holds no JSON, so it is not replaced; name another file, or - for stdout");
  expect_line({"meter", "--save-exposures", notes, in_}, 2, "name another file");
  expect_line(render({"--json", notes}), 2, notes + ": this file is there and holds no JSON");
  EXPECT_EQ(read_file(in_), image);
  EXPECT_EQ(read_file(notes), "mine\n");
  EXPECT_EQ(candela(render({"--json", json, "-q"})).code, 0);
  EXPECT_TRUE(says(read_file(json), "exposure"));
}

TEST_F(Slips, AnIlluminantIsShownInKelvin) {
  expect_line(render({"--white-balance", "D65"}), 2, "; for D65 write 6504");
  expect_line(render({"--white-balance", "d50"}), 2, "; for D50 write 5003");
  expect_line(render({"--key", "A"}), 2, "is not a number; it must be 1e-06 .. 1000000\n");
}

TEST_F(Slips, APercentileBelowOneIsTakenAndNoted) {
  expect_note(render({"--percentiles", "0.1,0.9"}), "note: --percentiles are in percent");
  expect_note({"meter", in_, "--percentiles", "0.05,0.95"}, "10 % to 90 % are --percentiles 10,90");
  EXPECT_FALSE(says(candela(render({"--percentiles", "0.1,99"})).err, "percent"));
}

TEST_F(Slips, ABackgroundOfCodesIsTakenAndNoted) {
  expect_note(render({"--background", "255,0,0"}), "note: --background is light");
  expect_note(render({"--background", "128,128,128"}), "the red of code 255 is --background 1,0,0");
  EXPECT_EQ(candela(render({"--background", "1,0,0"})).err, "");
  EXPECT_EQ(candela(render({"--background", "20.5,3,0"})).err, "");
}

TEST_F(Slips, AColourCodeAsBackgroundIsShownAsLight) {
  expect_line(render({"--background", "#ff0000"}), 2, "it is light, so write --background 1,0,0");
  expect_line(render({"--background", "#808080"}), 2, "so write --background 0.216,0.216,0.216");
  expect_line(render({"--background", "#f00"}), 2, "so write --background 1,0,0");
  expect_line(render({"--background", "#ff00"}), 2, "it must be 3 numbers separated by commas");
}

TEST_F(Slips, OnlyRenderStreamAndInfoTakePipes) {
  const std::string folder = folder_.path("frames"),
                    read = "IN is \"-\", but images cannot be read from a pipe";
  expect_line({"render", in_, "-", folder + "/"}, 2, "IN is \"-\" beside others");
  expect_line({"meter", "-"}, 2, read);
  expect_line({"view", "-", out_}, 2, read);
  expect_line({"environment", "-", folder_.path("sky.ktx2")}, 2, read);
  expect_line({"info", in_, "-"}, 2, "IN is \"-\" beside others");
  expect_line({"report", folder, "--images", "-"}, 2, read);
  for (const std::string pipe : {"-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"}) {
    const std::string written =
        "OUT is \"" + pipe + "\", but images cannot be written to a pipe; give a file";
    if (pipe != "-") {
      expect_line({"render", in_, pipe}, 2, written + ", or - for standard output");
      expect_line({"stream", in_, pipe}, 2, written + ", or - for standard output");
    }
    expect_line({"view", in_, pipe}, 2, written);
    expect_line({"environment", in_, pipe}, 2, written);
    expect_line({"sample", pipe}, 2, written);
  }
  // The JSON may go there.
  EXPECT_EQ(candela(render({"-q", "--json", "-"})).code, 0);
  const std::filesystem::path here = std::filesystem::current_path();
  std::filesystem::current_path(folder_.path(""));
  std::filesystem::copy_file(in_, folder_.path("-"));
  EXPECT_EQ(candela({"render", "./-", out_, "-q"}).code, 0);
  EXPECT_EQ(candela({"render", "-q", "--", "-", out_}).code, 0);
  std::filesystem::current_path(here);
}

TEST_F(Slips, AFilmIsAnOutputOfStreamAlone) {
  for (const char* name : {"out.mp4", "OUT.MOV", "out.webm"}) {
    const std::string film = folder_.path(name);
    for (const std::vector<std::string>& arguments :
         std::vector<std::vector<std::string>>{{"render", in_, film}, {"view", in_, film, "--turn", "360"}}) {
      expect_line(arguments, 2, "a film, which only candela stream makes; write out/%04d.png");
    }
  }
  EXPECT_FALSE(std::filesystem::exists(folder_.path("out.mp4")));
  expect_line({"stream", in_, folder_.path("out.avi")}, 2,
              "does not make; write a .mp4, .mov, .mkv or .webm");
}

TEST_F(Slips, FilesInAWrongPlaceAreSeen) {
  const std::string spaced = folder_.path("my shot.exr"), folder = folder_.path("folder");
  std::filesystem::copy_file(in_, spaced);
  std::filesystem::create_directory(folder);
  expect_line({"render", out_, in_}, 2, "the input comes first: candela render " + in_ + " " + out_);
  expect_line({"render", folder_.path("my"), "shot.exr", out_}, 2,
              spaced + " has a space in its name; write it in quotes");
  expect_line({"render", folder_.path("no"), "shot.exr", out_}, 2, "several images need a folder");
  expect_line({"render", in_, ""}, 2, "OUT is empty; give a file");
  expect_line({"render", in_, out_, "--ocio", in_}, 3, "it is an image; --ocio takes a configuration");
  expect_line({"render", folder, out_}, 2, "several images need a folder");
  expect_line({"info", folder}, 3, "folder: there is no .exr, .hdr");
  expect_line({"stream", folder, out_}, 2, "out.png is a single file; give a folder");
  expect_line({"report", in_}, 5, in_ + ": cannot write: Not a directory");
  EXPECT_EQ(candela({"view", in_, out_, "--size", "32X16", "-q"}).code, 0);
}

TEST_F(Slips, OptionsOfOtherProgramsAreTranslated) {
  expect_line({"render", in_, "-o", out_}, 2,
              "unknown option -o; the output is the last argument; see candela");
  expect_line(render({"--gamma", "2.2"}), 2, "--transfer gamma22 is that of a display");
  expect_line({"stream", in_, folder_.path("frames"), "--frames", "3"}, 2, "--range chooses frames");
  expect_line(render({"--view", "left"}), 2, "--ocio-view names a view of --ocio, --exr-view one of an");
  expect_line({"meter", in_, "--view", "left"}, 2, "--exr-view names a view of an OpenEXR file; see candela");
  expect_line(render({"--alpha", "none"}), 2, "ignore takes every pixel as opaque");
  EXPECT_EQ(candela({"info", "--frames"}).err,
            "candela: error: unknown option --frames; see candela info --help\n");
}

TEST_F(Slips, AServerWithoutAPortIsAskedOnCandeladsOwn) {
  for (const char* host : {"candela-test.invalid", "127.0.0.9", "[::1]"}) {
    const Outcome outcome = candela({"info", "--server", host});
    EXPECT_EQ(outcome.code, 4) << outcome.err;
    EXPECT_TRUE(says(outcome.err, "cannot reach " + std::string(host) + ":50051"));
  }
  expect_line(render({"--server", "::1"}), 2, "an IPv6 address has brackets, [::1]:50051");
  expect_line(render({"--server", "http://host:50051"}), 2, "leave out what stands before host:50051");
  expect_line(render({"--server", "/run/candelad.sock"}), 2, "a socket is unix:/run/candelad.sock");
  expect_line(render({"--server", "unix:/none"}), 4, "cannot reach unix:/none");
  expect_line(render({"--server", "50051"}), 2, "on this machine it is 127.0.0.1:50051");
  expect_line(render({"--server", "host:port"}), 2, "neither HOST:PORT");
}

TEST_F(Slips, ANameIsEscapedInTheTerminalAndWholeInJson) {
  const std::string name = folder_.path("a\nb\x1bm\xc2\x85\xff\xc3\xa4.exr");
  const std::string shown = folder_.path("a\\nb\\x1bm\\xc2\\x85\\xff\xc3\xa4.exr");
  expect_line({"render", name, out_}, 3, shown + ": cannot read");
  std::filesystem::copy_file(in_, name);
  const Outcome outcome = candela({"render", name, out_});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(outcome.out.find(shown + " -> " + out_), 0u) << outcome.out;
  EXPECT_EQ(std::count(outcome.out.begin(), outcome.out.end(), '\n'), 1) << outcome.out;
  EXPECT_EQ(candela({"info", name}).out.find(shown + ": OpenEXR"), 0u);
  EXPECT_EQ(candela({"meter", name}).out.find(shown + "\n"), 0u);
  const std::string plain = folder_.path("a\nb.exr");
  std::filesystem::copy_file(in_, plain);
  EXPECT_EQ(candela_json({"render", plain, out_}).at("input"), plain);
}

TEST_F(Slips, AnImageOfTooManyPixelsIsRefusedByItsHeader) {
  ASSERT_EQ(candela({"sample", folder_.path("a.pfm"), "--size", "40x10", "-q"}).code, 0);
  // Only headers: there is nothing to decode.
  const std::string hdr = folder_.path("a.hdr");
  write_file(hdr, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 10 +X 40\n");
  const std::string exr = folder_.path("a.exr");
  ASSERT_EQ(candela({"sample", exr, "--size", "40x10", "-q"}).code, 0);
  std::filesystem::resize_file(exr, std::filesystem::file_size(exr) - 8);
  const std::string words = "40x10, 400 pixels; --max-pixels allows 399";
  for (const std::string& path : {folder_.path("a.pfm"), hdr, exr}) {
    for (const std::vector<std::string>& arguments :
         std::vector<std::vector<std::string>>{{"render", path, out_},
                                               {"stream", path, folder_.path("frames")},
                                               {"meter", path},
                                               {"view", path, out_},
                                               {"environment", path, folder_.path("sky.ktx2")}}) {
      std::vector<std::string> limited = arguments;
      limited.insert(limited.end(), {"--max-pixels", "399"});
      expect_line(limited, 3, words);
    }
  }
  EXPECT_EQ(candela({"render", folder_.path("a.pfm"), out_, "--max-pixels", "400", "-q"}).code, 0);
  expect_line(render({"--max-pixels", "0"}), 2, "--max-pixels is 0; it must be a whole number, 1 .. ");
  expect_line(render({"--max-pixels", "4k"}), 2, "; write 4000");
  expect_line(render({"--max-pixels", "2.5M"}), 2, "; write 2500000");
}

TEST_F(Slips, NumbersHaveNoExponentAndNoMinusZero) {
  std::string pfm = "PF\n8 8\n-1.0\n";
  const float pixel[] = {0.18f, 0.18f, 0.18f};
  for (int i = 0; i < 64; ++i) pfm.append(reinterpret_cast<const char*>(pixel), sizeof pixel);
  const std::string grey = folder_.path("grey.pfm");
  write_file(grey, pfm);
  // Metered to a factor that is just below 1.
  const Outcome metered = candela({"render", grey, out_, "-v", "--key", "0.1799999"});
  EXPECT_TRUE(says(metered.out, "(+0.00 EV)"));
  const Outcome bright = candela({"render", grey, out_, "-v", "--exposure", "30", "--verify"});
  for (const std::string& text : {metered.out, bright.out, candela({"info"}).out}) {
    EXPECT_FALSE(says(text, "-0.00"));
    EXPECT_FALSE(says(text, "e+"));
  }
  // All components lie outside of the gamut.
  pfm = "PF\n8 8\n-1.0\n";
  const float green[] = {-1, 1, -1};
  for (int i = 0; i < 64; ++i) pfm.append(reinterpret_cast<const char*>(green), sizeof green);
  write_file(grey, pfm);
  const Outcome cut = candela({"render", grey, out_, "--exposure", "0"});
  EXPECT_FALSE(says(cut.err, "e+"));
}

}  // namespace
}  // namespace candela
