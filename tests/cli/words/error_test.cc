// Wrong uses and failures: each ends with its exit code and one line that says what is wrong and how to
// correct it, and leaves no file behind.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

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
            "out.png is no image that candela can read (OpenEXR, Radiance "
            ".hdr, PFM, PNG, AVIF, JPEG), and the last argument, more, is"},
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
            "not an OpenEXR, Radiance, PFM, PNG, AVIF or JPEG file"},
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
