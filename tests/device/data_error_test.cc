// The whole-frame error on real images: every good file of CANDELA_DATA.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "tests/support/frame_error.h"
#include "tests/support/settings.h"

namespace candela::testing {
namespace {

namespace fs = std::filesystem;

using DataError = FrameErrorTest;

fs::path data_folder() {
  const char* named = std::getenv("CANDELA_DATA");
  return named != nullptr ? named : CANDELA_DATA_DEFAULT;
}

std::vector<fs::path> good_files() {
  // This file is rightly refused; the command's tests check that.
  const std::set<std::string> refused = {"Trunks_deep.exr"};
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(data_folder())) {
    const fs::path& path = entry.path();
    const bool image = path.extension() == ".exr" || path.extension() == ".hdr" || path.extension() == ".pfm";
    if (image && path.parent_path().filename() != "bad" && !refused.contains(path.filename()))
      files.push_back(path);
  }
  std::sort(files.begin(), files.end());
  return files;
}

TEST_F(DataError, IsWithinItsBoundOnEveryRealImage) {
  if (!fs::is_directory(data_folder()))
    GTEST_SKIP() << "no test images at " << data_folder() << "; set CANDELA_DATA";
  const std::vector<fs::path> files = good_files();
  EXPECT_GT(files.size(), 40u);
  print_header("real images, codes against the reference");
  for (const fs::path& path : files) {
    const absl::StatusOr<Image> image = read_image(path);
    ASSERT_TRUE(image.ok()) << image.status();
    const v1::PixelFormat format =
        image->format == ImageFormat::kRgba16f ? v1::PIXEL_FORMAT_RGBA16F : v1::PIXEL_FORMAT_RGBA32F;
    const auto pixels = image->pixels.span();
    const WireFrame frame{{image->width, image->height, format}, {pixels.begin(), pixels.end()}};
    v1::Settings settings;
    if (image->chromaticities) {
      Chromaticities chromaticities;
      std::copy(image->chromaticities->begin(), image->chromaticities->end(), chromaticities.xy.begin());
      *settings.mutable_input_chromaticities() = to_message(chromaticities);
    }
    // This image has every half side by side, and components of +-65504 cancel in the curve's matrix.
    const bool every_half = path.filename() == "AllHalfValues.exr";
    check(frame, settings, fs::relative(path, data_folder()),
          every_half ? Bounds{.max = 0.0085, .p999 = 1e-3} : Bounds());
  }
}

}  // namespace
}  // namespace candela::testing
