// The command with a running candelad.
#include <gtest/gtest.h>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class WithServer : public ::testing::Test {
 protected:
  void SetUp() override {
    write_small_exr(in_);
    out_ = folder_.path("out.png");
  }
  TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  std::string out_;
};

TEST_F(WithServer, ItGivesTheBytesThatTheEmbeddedOneGives) {
  const ListeningDaemon daemon;
  ASSERT_NE(daemon.address(), "");
  const std::string scene = folder_.path("scene.exr");
  ASSERT_EQ(candela({"sample", scene, "--size", "641x359", "-q"}).code, 0);
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {}, {"--bits", "16", "--curve", "reinhard"}, {"--exposure", "-3", "--bloom-intensity", "0.5"}}) {
    std::vector<std::string> here = with({"render", scene, folder_.path("here.png")}, options);
    std::vector<std::string> there = here;
    there[2] = out_;
    there.insert(there.end(), {"--server", daemon.address()});
    ASSERT_EQ(candela(here).code, 0);
    const Outcome outcome = candela(there);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(read_file(folder_.path("here.png")) == read_file(out_));
  }
}

TEST_F(WithServer, HealthAndInfoAnswer) {
  ListeningDaemon daemon({"--listen", "unix:" + folder_.path("socket")});
  ASSERT_EQ(daemon.address(), "unix:" + folder_.path("socket"));
  const Outcome health = candela({"health", "--server", daemon.address()});
  EXPECT_EQ(health.code, 0) << health.err;
  EXPECT_EQ(health.out, "SERVING\n");
  ASSERT_EQ(candela({"render", in_, out_, "--server", daemon.address()}).code, 0);
  const nlohmann::json info = candela_json({"info", "--server", daemon.address()});
  EXPECT_EQ(info.at("address"), daemon.address());
  EXPECT_EQ(info.at("frames_rendered"), 1);
  EXPECT_GT(info.at("pool").at("misses"), 0);
  daemon.stop();
  EXPECT_EQ(candela({"health", "--server", "unix:" + folder_.path("socket")}).code, 1);
}

TEST_F(WithServer, ItsLimitsHoldForTheFileBeforeItIsRead) {
  const ListeningDaemon daemon({"--max-dimension", "30"});
  const Outcome outcome = candela({"render", in_, out_, "--server", daemon.address()});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_TRUE(says(outcome.err, "the limit is 30 on a side"));
  EXPECT_TRUE(says(outcome.err, in_));
  const ListeningDaemon small({"--max-frame-bytes", "1024"});
  const Outcome bytes = candela({"render", in_, out_, "--server", small.address()});
  EXPECT_EQ(bytes.code, 3);
  EXPECT_TRUE(says(bytes.err, in_));
  EXPECT_EQ(png_facts(out_).width, 0u);
}

#ifndef CANDELA_SANITIZED  // a sanitizer has mappings of its own
TEST_F(WithServer, MemoryThatRunsOutIsAnErrorInOneLine) {
  const ListeningDaemon daemon;
  const std::string scene = folder_.path("scene.pfm");
  ASSERT_EQ(candela({"sample", scene, "--size", "1024x600", "-q"}).code, 0);
  const auto render = [&](const char* mappings) {
    return candela_on_failing_machine("CANDELA_TEST_MAPPINGS", mappings,
                                      {"render", scene, out_, "--server", daemon.address()});
  };
  EXPECT_EQ(render("1").code, 0);  // the image takes its frame's memory
  const Outcome outcome = render("0");
  EXPECT_EQ(outcome.code, 1);
  EXPECT_TRUE(says(outcome.err, "memory")) << outcome.err;
  const Outcome stream = candela_on_failing_machine(
      "CANDELA_TEST_MAPPINGS", "1", {"stream", scene, folder_.path("out"), "--server", daemon.address()});
  EXPECT_EQ(stream.code, 1);
  EXPECT_TRUE(says(stream.err, "out of memory"));
}
#endif

TEST_F(WithServer, AnUnknownTierIsAWrongUseThatListsItsTiers) {
  const ListeningDaemon daemon;
  const Outcome outcome = candela({"render", in_, out_, "--server", daemon.address(), "--tier", "standart"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(says(outcome.err, "did you mean standard?"));
}

}  // namespace
}  // namespace candela
