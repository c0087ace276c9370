#include <gtest/gtest.h>
#include <sys/stat.h>

#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

TEST(ReadImage, SaysWhatIsWrongWithThePath) {
  TemporaryFolder folder;
  const auto error = [](const std::string& path) { return read_image(path).status(); };
  EXPECT_REFUSED(kNotFound, "missing.exr: cannot read: No such file", error(folder.path("missing.exr")));
  EXPECT_TRUE(says(error(folder.path("")).message(), "is a folder"));
  write_file(folder.path("empty.exr"), "");
  EXPECT_TRUE(says(error(folder.path("empty.exr")).message(), "the file is empty"));
  write_file(folder.path("text.exr"), "hello");
  EXPECT_TRUE(says(error(folder.path("text.exr")).message(), "not an OpenEXR, Radiance, PFM, PNG, AVIF or JPEG file"));
  ASSERT_EQ(mkfifo(folder.path("pipe.hdr").c_str(), 0600), 0);
  EXPECT_TRUE(says(error(folder.path("pipe.hdr")).message(), "not a regular file"));
}

TEST(ReadImage, GoesByContentNotByName) {
  TemporaryFolder folder;
  write_file(folder.path("really.exr"), "PF\n1 1\n-1\n" + std::string(12, 'x'));
  EXPECT_OK(read_image(folder.path("really.exr")));
}

}  // namespace
}  // namespace candela
