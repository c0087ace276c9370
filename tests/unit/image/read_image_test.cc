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
  EXPECT_NE(error(folder.path("")).message().find("is a folder"), absl::string_view::npos);
  write_file(folder.path("empty.exr"), "");
  EXPECT_NE(error(folder.path("empty.exr")).message().find("the file is empty"), absl::string_view::npos);
  write_file(folder.path("text.exr"), "hello");
  EXPECT_NE(error(folder.path("text.exr")).message().find("not an OpenEXR, Radiance or PFM file"),
            absl::string_view::npos);
  ASSERT_EQ(mkfifo(folder.path("pipe.hdr").c_str(), 0600), 0);
  EXPECT_NE(error(folder.path("pipe.hdr")).message().find("not a regular file"), absl::string_view::npos);
}

TEST(ReadImage, GoesByContentNotByName) {
  TemporaryFolder folder;
  write_file(folder.path("really.exr"), "PF\n1 1\n-1\n" + std::string(12, 'x'));
  EXPECT_OK(read_image(folder.path("really.exr")));
}

}  // namespace
}  // namespace candela
