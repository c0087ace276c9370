// The limits of the shell and odd files: one line, the exit code of its kind, and nothing left behind.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class Limits : public ::testing::Test {
 protected:
  void SetUp() override { write_small_exr(in_); }

  void expect_failure(const Outcome& outcome, const std::string& words, int code = 1) const {
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_EQ(outcome.err.find("candela: error: "), 0u) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string out_ = folder_.path("out.png");
};

TEST_F(Limits, AFileThatMayNotBecomeSoLargeIsAnErrorAndTheOldOneStays) {
  const std::string scene = folder_.path("scene.exr");
  ASSERT_EQ(candela({"sample", scene, "--size", "320x180", "-q"}).code, 0);
  for (const std::string& path :
       {out_, folder_.path("out.tif"), folder_.path("out.exr"), folder_.path("out.pfm")}) {
    write_file(path, "old");
    const std::vector<std::string> before = folder_.list();
    expect_failure(candela_with_ulimit("-f 8", {"sample", path.substr(0, path.size() - 4) + ".pfm"}),
                   "too large", 5);
    expect_failure(candela_with_ulimit("-f 8", {"render", scene, path, "-q"}),
                   path + ": cannot write: File too large", 5);
    EXPECT_EQ(read_file(path), "old");
    EXPECT_EQ(folder_.list(), before);
  }
}

#ifndef CANDELA_SANITIZED  // a sanitizer reserves terabytes of addresses
TEST_F(Limits, TooLittleAddressSpaceIsSaidBeforeTheWork) {
  for (const char* mib : {"300", "500", "700", "900", "1100", "1300"}) {
    SCOPED_TRACE(mib);
    const std::string limit = std::string("-v $((") + mib + " * 1024))";
    expect_failure(candela_with_ulimit(limit, {"render", in_, out_, "-q"}),
                   "ulimit -v allows " + std::string(mib));
    expect_failure(candela_with_ulimit(limit, {"stream", in_, folder_.path("out"), "-q"}),
                   "the built-in server needs");
    EXPECT_EQ(candela_with_ulimit(limit, {"info", in_}).code, 0);
  }
  EXPECT_EQ(folder_.list(), std::vector<std::string>{"in.exr"});
}
#endif

#ifndef CANDELA_SANITIZED  // a sanitizer wants to be loaded first
TEST_F(Limits, ADiskThatIsFullIsAnErrorAndTheOldFileStays) {
  const std::string scene = folder_.path("scene.exr"), frames = folder_.path("frames");
  ASSERT_EQ(candela({"sample", scene, "--size", "320x180", "-q"}).code, 0);
  for (const char* name : {"0000.exr", "0001.exr"}) {
    std::filesystem::copy_file(scene, folder_.path(name));
  }
  const std::string sequence = folder_.path("%04d.exr"), picture = frames + "/0000.png";
  std::filesystem::create_directory(frames);
  for (const std::string& path : {out_, folder_.path("out.exr"), picture}) write_file(path, "old");
  const std::vector<std::string> before = folder_.list();
  const std::string full = ": cannot write: No space left on device";
  // Nothing fits, or what is written before the end fits.
  for (const char* bytes : {"0", "3000"}) {
    const auto on_full_disk = [bytes](const std::vector<std::string>& arguments) {
      return candela_on_failing_machine("CANDELA_TEST_DISK_BYTES", bytes, arguments);
    };
    for (const std::string& path : {out_, folder_.path("out.exr")}) {
      expect_failure(on_full_disk({"render", scene, path, "-q"}), path + full, 5);
      EXPECT_EQ(read_file(path), "old");
    }
    expect_failure(on_full_disk({"render", scene, out_, "-q", "--json", folder_.path("new.json")}), full, 5);
    for (const char* encoding : {"raw", "png"}) {
      expect_failure(on_full_disk({"stream", sequence, frames + "/%04d.png", "-q", "--encoding", encoding}),
                     picture + full, 5);
      EXPECT_EQ(read_file(picture), "old");
      EXPECT_EQ(std::distance(std::filesystem::directory_iterator(frames), {}), 1);
    }
    EXPECT_EQ(folder_.list(), before);
  }
}

TEST_F(Limits, AStreamThatGetsNoMoreThreadsIsAnError) {
  const std::string frames = folder_.path("frames");
  ASSERT_EQ(candela({"sample", "--sequence", frames, "--frames", "12", "--size", "320x180", "-q"}).code, 0);
  expect_failure(candela_on_failing_machine("CANDELA_TEST_NO_THREADS", "1",
                                            {"stream", frames, folder_.path("out"), "-q"}),
                 "cannot start a thread");
  for (const auto& file : std::filesystem::recursive_directory_iterator(folder_.path("out"))) {
    EXPECT_EQ(file.path().extension(), ".png") << file.path();
  }
}

// The session has one thread. The bench has one that submits frames and one that takes results.
TEST_F(Limits, ABenchThatGetsNoMoreThreadsIsAnError) {
  const ListeningDaemon daemon;
  const std::vector<std::string> bench{"bench", "--server", daemon.address(), "--size", "64x64", "--seconds",
                                       "1",     "-q"};
  for (const char* threads : {"1", "2"}) {
    SCOPED_TRACE(threads);
    expect_failure(candela_on_failing_machine("CANDELA_TEST_STD_THREADS", threads, bench),
                   "cannot start a thread");
  }
  EXPECT_EQ(candela_on_failing_machine("CANDELA_TEST_STD_THREADS", "3", bench).code, 0);
}
#endif

TEST_F(Limits, APictureNeedsAPlainFile) {
  const std::string full = folder_.path("full.png"), loop = folder_.path("loop.png"),
                    pipe = folder_.path("pipe.png");
  std::filesystem::create_symlink("/dev/full", full);
  std::filesystem::create_symlink("loop.png", loop);
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);  // nobody reads it
  const std::vector<std::string> before = folder_.list();
  for (const auto& [path, words] :
       std::vector<std::pair<std::string, std::string>>{{full, full + ": cannot write: this is a device"},
                                                        {loop, "Too many levels of symbolic links"},
                                                        {pipe, pipe + ": cannot write: this is a FIFO"}}) {
    expect_failure(candela({"render", in_, path, "-q"}), words, 5);
    expect_failure(candela({"render", in_, out_, "-q", "--error-map", path}), words, 5);
    expect_failure(candela({"view", in_, path, "-q"}), words, 5);
    expect_failure(candela({"environment", in_, folder_.path("sky.ktx2"), "-q", "--preview", path}), words,
                   5);
  }
  const Outcome device = candela({"render", in_, "/dev/full", "-q"});
  EXPECT_EQ(device.code, 2) << device.err;
  EXPECT_EQ(device.err,
            "candela: error: /dev/full: images are not written as ''; use .png, .jpg, .jpeg, .tif, .tiff, "
            ".avif, .exr or .pfm\n");
  EXPECT_EQ(folder_.list(), before);
  EXPECT_EQ(std::filesystem::read_symlink(full), "/dev/full");
}

TEST_F(Limits, AnInputThatIsNoImageIsOneLine) {
  const std::string loop = folder_.path("loop.exr"), folder = folder_.path("out");
  std::filesystem::create_symlink("loop.exr", loop);
  const std::vector<std::string> before = folder_.list();
  const std::string no_file = "not a regular file";
  for (const auto& [path, words] : std::vector<std::pair<std::string, std::string>>{
           {"", "cannot read: No such file"},
           {"/dev/urandom", no_file},
           {"/dev/stdin", no_file},
           {"/proc/self/mem", "cannot read: Input/output error"},
           {"/proc/self/maps", "not an OpenEXR, Radiance, PFM, PNG, AVIF, JPEG or TIFF file"},
           {loop, "Too many levels of symbolic links"},
           {std::string(5000, 'a'), "File name too long"}}) {
    expect_failure(candela({"render", path, out_, "-q"}), words, 3);
    expect_failure(candela({"info", path}), words, 3);
  }
  for (const std::string& pattern : {std::string(1000, '['), std::string("["), std::string("none*")}) {
    expect_failure(candela({"render", folder_.path(pattern), folder + "/", "-q"}), "no such file", 3);
    expect_failure(candela({"stream", folder_.path(pattern), folder, "-q"}), "no such file", 3);
  }
  expect_failure(candela_in_shell("exec <&-", {"render", "/dev/stdin", out_, "-q"}), no_file, 3);
  EXPECT_EQ(folder_.list(), before);
  // No temporary file is kept elsewhere.
  EXPECT_EQ(candela_in_shell("export TMPDIR=/none", {"stream", in_, folder, "-q"}).code, 0);
}

// Temporary files have longer names, and a name is 255 bytes at most.
TEST_F(Limits, NamesMayBeAsLongAsTheSystemAllows) {
  for (const size_t letters : {250u, 251u}) {
    const std::string longest = folder_.path(std::string(letters, 'x') + ".png");
    EXPECT_EQ(candela({"render", in_, longest, "-q"}).code, 0);
    EXPECT_TRUE(std::filesystem::is_regular_file(longest)) << letters;
  }
  const std::vector<std::string> before = folder_.list();
  expect_failure(candela({"render", in_, folder_.path(std::string(252, 'x') + ".png"), "-q"}),
                 "cannot write: File name too long", 5);
  EXPECT_EQ(folder_.list(), before);
}

// Names are bytes. They are no formats, and need not be UTF-8.
TEST_F(Limits, NamesAreTakenAsTheyAre) {
  for (const std::string name : {"%n%s%d", "\xff\xfe", "a\xc3"}) {
    const std::string in = folder_.path(name + ".exr"), out = folder_.path(name + ".png"),
                      json = folder_.path(name + ".json");
    std::filesystem::copy_file(in_, in);
    const Outcome outcome = candela({"render", in, out, "--json", json});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    EXPECT_EQ(png_facts(out).width, 31u);
    EXPECT_TRUE(nlohmann::json::parse(read_file(json), nullptr, false).is_object()) << read_file(json);
  }
  expect_failure(candela({"render", folder_.path("\xff.exr"), out_}), "No such file or directory", 3);
  for (const char* pattern : {"%n.png", "%s.png", "%999999999d.png", "%04d%04d.png"}) {
    const Outcome outcome = candela({"stream", in_, folder_.path(pattern), "-q"});
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_TRUE(says(outcome.err, "a pattern has one number"));
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  }
}

// The pictures would get the descriptors of closed streams, and our messages with them.
TEST_F(Limits, ClosedStreamsAreNotWrittenTo) {
  expect_failure(candela_in_shell("exec >&-", {"render", in_, out_, "-q", "--json", "-"}),
                 "stdout: cannot write: Bad file descriptor", 5);
  EXPECT_EQ(folder_.list(), std::vector<std::string>{"in.exr"});
  for (const char* closed : {"exec >&-", "exec 2>&-", "exec <&- >&- 2>&-"}) {
    const Outcome outcome = candela_in_shell(closed, {"render", in_, out_, "-v"});
    EXPECT_EQ(outcome.code, 0) << closed << outcome.err;
    EXPECT_EQ(outcome.err, "");
    EXPECT_EQ(png_facts(out_).width, 31u) << closed;
    EXPECT_EQ(candela_in_shell(closed, {"render", in_ + "x", out_}).code, 3) << closed;
  }
}

TEST_F(Limits, TooFewOpenFilesAreSaidBeforeTheWork) {
#ifdef CANDELA_SANITIZED  // UBSan checks a pointer with a pipe, which takes two descriptors
  const std::vector<const char*> limits = {"-n 6", "-n 10", "-n 47"};
#else
  const std::vector<const char*> limits = {"-n 5", "-n 6", "-n 10", "-n 47"};
#endif
  for (const char* limit : limits) {
    SCOPED_TRACE(limit);
    expect_failure(candela_with_ulimit(limit, {"render", in_, out_, "-q"}),
                   "ulimit -n allows " + std::string(limit + 3) + " open files and candela needs 48");
    expect_failure(candela_with_ulimit(limit, {"stream", in_, folder_.path("out"), "-q"}), "ulimit -n");
    expect_failure(candela_with_ulimit(limit, {"health", "--server", "127.0.0.1:1"}), "ulimit -n");
  }
  EXPECT_EQ(folder_.list(), std::vector<std::string>{"in.exr"});
  // A soft limit is raised.
  for (const char* limit : {"-n 48", "-S -n 10"}) {
    const Outcome outcome = candela_with_ulimit(limit, {"render", in_, out_, "-q"});
    EXPECT_EQ(outcome.code, 0) << limit << ": " << outcome.err;
  }
}

TEST_F(Limits, APipeInPlaceOfAFileIsNotWaitedFor) {
  const std::string pipe = folder_.path("pipe");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const std::string folder = folder_.path("out"), nowhere = "127.0.0.1:1";
  const std::string no_file = "not a regular file";
  expect_failure(candela({"stream", in_, folder, "-q", "--exposures", pipe}), no_file, 3);
  expect_failure(candela({"stream", in_, folder, "-q", "--state", pipe}), no_file, 3);
  expect_failure(candela({"render", in_, out_, "-q", "--locked-exposure", pipe}), no_file, 3);
  expect_failure(candela({"render", in_, out_, "-q", "--ocio", pipe}), no_file, 3);
  for (const char* option : {"--token-file", "--tls-ca"}) {
    const Outcome outcome = candela({"render", in_, out_, "-q", "--server", nowhere, option, pipe});
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_TRUE(says(outcome.err, no_file));
  }
}

TEST_F(Limits, AKeyThatAnExposureFileHoldsTwiceIsRefused) {
  const std::string shot = folder_.path("shot.json");
  ASSERT_EQ(candela({"meter", in_, "-q", "--save-exposures", shot}).code, 0);
  std::string text = read_file(shot);
  const size_t at = text.find("\"locked\"");
  ASSERT_NE(at, std::string::npos);
  text.insert(at, "\"locked\": 1e-3,\n ");
  write_file(shot, text);
  expect_failure(candela({"render", in_, out_, "-q", "--locked-exposure", shot}), "\"locked\" is there twice",
                 3);
}

}  // namespace
}  // namespace candela
