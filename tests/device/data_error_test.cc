// The whole-frame error on real images: every good file of CANDELA_DATA.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "tests/support/files.h"
#include "tests/support/frame_error.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

namespace fs = std::filesystem;

using DataError = FrameErrorTest;

// One of the files has chunks of 387 MiB.
ImageLimits limits() { return {.max_chunk_bytes = 512u << 20}; }

std::vector<fs::path> good_files() {
  // These files are rightly refused; the command's tests check that.
  const std::set<std::string> refused = {"Trunks_deep.exr", "D01_htj2k.exr", "D02_unfinished.exr",
                                         "D03_tiles_missing.exr"};
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
    ASSERT_OK_AND_ASSIGN(const Image image, read_image(path, limits()));
    // This image has every half side by side, and components of +-65504 cancel in the curve's matrix.
    const bool every_half = path.filename() == "AllHalfValues.exr";
    check(frame_of(image), settings_of(image), fs::relative(path, data_folder()),
          every_half ? Bounds{.max = 0.0085, .p999 = 1e-3} : Bounds());
  }
}

// With strong bloom draft may be 90 codes off, so a promise of 7 needs more where something blooms.
TEST_F(DataError, IsWithinAPromiseOnRealImages) {
  if (!fs::is_directory(data_folder()))
    GTEST_SKIP() << "no test images at " << data_folder() << "; set CANDELA_DATA";
  constexpr uint64_t kMaxPixels =
      600'000;                          // for time; larger images and later frames of a sequence add nothing
  constexpr double kFloatCodes = 5e-5;  // what verification cannot tell apart: its images are floats
  constexpr double kPromise = 7;
  std::set<std::string> taken;
  int checked = 0;
  for (const fs::path& path : good_files()) {
    if (path.string().find("/sequence/") != std::string::npos && !path.stem().string().ends_with(".0001"))
      continue;
    ASSERT_OK_AND_ASSIGN(const Image image, read_image(path, limits()));
    if (uint64_t{image.width} * image.height > kMaxPixels) continue;
    ++checked;
    v1::Settings settings = settings_of(image);
    settings.mutable_bloom()->set_threshold(0.3f);
    settings.mutable_bloom()->set_intensity(2);
    settings.set_max_error_codes(kPromise);
    const auto rendered = render(frame_of(image), settings, {}, Verify::kYes);
    ASSERT_OK(rendered) << path;
    const FrameReport& report = rendered->report;
    ASSERT_TRUE(report.error_bound && report.verification) << path;
    const double error = report.verification->rounded.max_codes;
    std::printf("%-44s %-10s bound %-9.4g error %.6f\n", fs::relative(path, data_folder()).c_str(),
                report.tier.c_str(), *report.error_bound, error);
    EXPECT_LE(*report.error_bound, kPromise) << path;
    EXPECT_LE(error, *report.error_bound + kFloatCodes) << path << ": " << report.tier_reason;
    taken.insert(report.tier);
  }
  EXPECT_GT(checked, 25);
  EXPECT_TRUE(taken.contains("standard")) << "no image blooms";
}

}  // namespace
}  // namespace candela::testing
