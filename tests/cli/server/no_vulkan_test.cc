// The built-in server without Vulkan.
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class NoVulkan : public ::testing::Test {
 protected:
  void SetUp() override {
    if (std::filesystem::exists("/dev/dri") || std::filesystem::exists("/dev/nvidiactl")) {
      GTEST_SKIP() << "a GPU may render here";
    }
    ASSERT_EQ(candela({"sample", in_, "--size", "641x359", "-q"}).code, 0);
    // The dynamic linker goes no further than a library that it cannot read.
    std::filesystem::create_directory(folder_.path("lib"));
    write_file(folder_.path("lib/libvulkan.so.1"), "");
  }

  Outcome without_loader(const std::vector<std::string>& arguments) const {
    return candela_in_shell("export LD_LIBRARY_PATH='" + folder_.path("lib") + "'", arguments);
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr"), out_ = folder_.path("out.png");
};

TEST_F(NoVulkan, RendersTheSameBitsWithoutTheLoader) {
  for (const char* const tier : {"draft", "standard", "reference"}) {
    const Outcome rendered = without_loader({"render", in_, out_, "--tier", tier, "-v"});
    ASSERT_EQ(rendered.code, 0) << rendered.err;
    EXPECT_TRUE(says(rendered.out, "host, tier ")) << rendered.out;
    const std::string vulkan = folder_.path("vulkan.png");
    const Outcome other =
        candela({"render", in_, vulkan, "--tier", tier, "--device", "llvmpipe", "--executor", "host", "-q"});
    ASSERT_EQ(other.code, 0) << other.err;
    EXPECT_TRUE(read_file(out_) == read_file(vulkan)) << tier;
  }
  const Outcome info = without_loader({"info"});
  EXPECT_EQ(info.code, 0) << info.err;
  EXPECT_TRUE(says(info.out, "driver     none: there is no Vulkan device")) << info.out;
}

TEST_F(NoVulkan, LoadsNeitherLoaderNorDriver) {
  const std::string log = folder_.path("loaded");
  const Outcome rendered =
      candela_in_shell("export LD_DEBUG=files LD_DEBUG_OUTPUT='" + log + "'", {"render", in_, out_, "-q"});
  ASSERT_EQ(rendered.code, 0) << rendered.err;
  std::string loaded;
  for (const std::string& name : folder_.list()) {
    if (name.starts_with("loaded.")) loaded += read_file(folder_.path(name));
  }
  EXPECT_TRUE(says(loaded, "libOpenEXR"));
  for (const char* const library : {"libvulkan", "libLLVM"}) EXPECT_FALSE(says(loaded, library)) << library;
}

TEST_F(NoVulkan, AnEnvironmentNeedsItAndTheErrorSaysWhatToInstall) {
  const std::string pano = folder_.path("pano.exr");
  ASSERT_EQ(candela({"sample", "--panorama", pano, "--size", "32x16", "-q"}).code, 0);
  for (const std::vector<std::string>& command :
       std::vector<std::vector<std::string>>{{"view", pano, out_, "--size", "8x8"},
                                             {"environment", pano, folder_.path("out.ktx2")},
                                             {"render", in_, out_, "--executor", "device"},
                                             {"render", in_, out_, "--device", "llvmpipe"}}) {
    const Outcome refused = without_loader(command);
    EXPECT_EQ(refused.code, 4) << refused.out;
    EXPECT_TRUE(says(refused.err, "no Vulkan loader found: install Debian's mesa-vulkan-drivers"))
        << refused.err;
  }
  const Outcome refused =
      candela({"view", pano, out_, "--size", "8x8", "--device", "host", "--executor", "auto"});
  EXPECT_EQ(refused.code, 4) << refused.out;
  EXPECT_TRUE(says(refused.err, "without --device host")) << refused.err;
}

}  // namespace
}  // namespace candela
