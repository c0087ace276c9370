// Images by their content, and real files of the test data.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "client/image/describe.h"
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
  EXPECT_TRUE(says(error(folder.path("text.exr")).message(),
                   "not an OpenEXR, Radiance, PFM, PNG, AVIF, JPEG or TIFF file"));
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

// Reads the shared test data: real files of every kind, and damaged ones.

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;  // the shadow memory needs more address space than the limit
#else
constexpr bool kSanitized = false;
#endif

namespace candela {
namespace {

class ImageData : public ::testing::Test {
 protected:
  void SetUp() override {
    if (root_.empty()) GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
  }
  Image read(const std::string& name) {
    absl::StatusOr<Image> image = read_image(root_ + "/" + name);
    EXPECT_OK(image);
    return image.ok() ? *std::move(image) : Image{};
  }
  const std::string root_ = data_folder();
};

// The median over all components of |a - b| / max(b, 0.01).
double median_difference(const Image& a, const Image& b) {
  std::vector<double> differences;
  for (uint32_t y = 0; y < b.height; ++y) {
    for (uint32_t x = 0; x < b.width; ++x) {
      for (int c = 0; c < 3; ++c) {
        const double expected = component(b, x, y, c);
        differences.push_back(std::fabs(component(a, x, y, c) - expected) / std::max(expected, 0.01));
      }
    }
  }
  std::nth_element(differences.begin(), differences.begin() + static_cast<ptrdiff_t>(differences.size() / 2),
                   differences.end());
  return differences[differences.size() / 2];
}

// CIE XYZ to linear Rec.709 by the D65 matrix, which the published files of that picture use.
Image to_rec709(const Image& xyz) {
  Image out = *make_image(xyz.width, xyz.height, ImageFormat::kRgba32f);
  constexpr double kMatrix[3][3] = {{3.2404542, -1.5371385, -0.4985314},
                                    {-0.9692660, 1.8760108, 0.0415560},
                                    {0.0556434, -0.2040259, 1.0572252}};
  auto* to = reinterpret_cast<float*>(out.pixels.data());
  for (uint32_t y = 0; y < xyz.height; ++y) {
    for (uint32_t x = 0; x < xyz.width; ++x, to += 4) {
      for (int c = 0; c < 3; ++c) {
        double sum = 0;
        for (int k = 0; k < 3; ++k) sum += kMatrix[c][k] * component(xyz, x, y, k);
        to[c] = static_cast<float>(sum);
      }
    }
  }
  return out;
}

TEST_F(ImageData, EveryGoodFileReads) {
  for (const char* folder :
       {"exr", "chromaticities", "display_window", "compression", "hdri", "radiance", "aces", "sequence"}) {
    for (const std::string& path : data_files(folder)) {
      if (path.ends_with("Trunks_deep.exr")) continue;
      EXPECT_OK(read_image(path));
    }
  }
}

TEST_F(ImageData, DeepImagesAreRefusedByName) {
  const absl::Status status = read_image(root_ + "/exr/Trunks_deep.exr").status();
  EXPECT_TRUE(says(status.message(), "is a deep image"));
}

TEST_F(ImageData, EveryDamagedFileIsRefusedFastAndInLittleMemory) {
  for (const std::string& path : data_files("bad")) {
    if (path.ends_with("21_type_attribute_lies.exr")) continue;  // a whole picture, on which readers differ
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      const rlimit memory{1u << 30, 1u << 30};
      if (!kSanitized) setrlimit(RLIMIT_AS, &memory);
      alarm(20);
      const absl::Status status = read_image(path).status();
      const bool named =
          status.message().find(path) == 0 && status.message().find('\n') == absl::string_view::npos;
      _exit(status.ok() ? 1 : named ? 0 : 2);
    }
    int result = 0;
    ASSERT_EQ(waitpid(child, &result, 0), child);
    EXPECT_EQ(result, 0) << path;
  }
}

TEST_F(ImageData, LosslessCompressionsAgreeBitForBit) {
  const Image none = read("compression/comp_none.exr");
  EXPECT_TRUE(same_pixels(none, read("compression/comp_piz.exr")));
  EXPECT_TRUE(same_pixels(none, read("compression/comp_zip.exr")));
}

TEST_F(ImageData, DwaDecodesWithinItsTolerance) {
  const Image dwa = read("compression/comp_dwaa_v2.exr"), expected = read("compression/comp_dwaa_piz.exr");
  for (uint32_t y = 0; y < dwa.height; ++y) {
    for (uint32_t x = 0; x < dwa.width; ++x) {
      for (int c = 0; c < 4; ++c) ASSERT_NEAR(component(dwa, x, y, c), component(expected, x, y, c), 0.006);
    }
  }
}

TEST_F(ImageData, RadianceAndOpenExrHoldTheSamePicture) {
  const Image hdr = read("hdri/arboretum.hdr"), exr = read("hdri/arboretum.exr");
  ASSERT_EQ(hdr.width, exr.width);
  for (uint32_t y = 0; y < hdr.height; ++y) {
    for (uint32_t x = 0; x < hdr.width; ++x) {
      for (int c = 0; c < 3; ++c)
        ASSERT_EQ(component(hdr, x, y, c), component(exr, x, y, c)) << x << ", " << y;
    }
  }
}

TEST_F(ImageData, RadianceVariantsHoldTheSamePicture) {
  const Image expected = read("radiance/v_rle.hdr");
  for (const char* name : {"v_flat.hdr", "v_magic_rgbe.hdr", "v_bottom_up.hdr"}) {
    EXPECT_TRUE(same_pixels(read(std::string("radiance/") + name), expected)) << name;
  }
  const Image exposed = read("radiance/v_exposure.hdr");
  EXPECT_EQ(component(exposed, 10, 20, 1), 2 * component(expected, 10, 20, 1));
  EXPECT_LT(median_difference(to_rec709(read("radiance/v_xyze.hdr")), expected), 0.02);
}

TEST_F(ImageData, FourEncodingsOfOnePictureAgree) {
  const Image expected = read("chromaticities/Rec709.exr");
  EXPECT_FALSE(expected.chromaticities.has_value());
  EXPECT_LT(median_difference(read("chromaticities/Rec709_YC.exr"), expected), 0.02);
  for (const char* name : {"chromaticities/XYZ.exr", "chromaticities/XYZ_YC.exr"}) {
    const Image xyz = read(name);
    ASSERT_TRUE(xyz.chromaticities.has_value());
    EXPECT_EQ((*xyz.chromaticities)[0], 1);
    EXPECT_LT(median_difference(to_rec709(xyz), expected),
              std::string(name).ends_with("YC.exr") ? 0.02 : 0.001);
  }
}

TEST_F(ImageData, WindowsShowTheSamePixelsMoved) {
  const Image whole = read("display_window/t01.exr");
  const auto moved = [&](const char* name, int left, int top) {
    const Image image = read(std::string("display_window/") + name);
    for (uint32_t y = 0; y < image.height; ++y) {
      for (uint32_t x = 0; x < image.width; ++x) {
        const int wx = static_cast<int>(x) + left, wy = static_cast<int>(y) + top;
        const bool inside = wx >= 0 && wy >= 0 && wx < 400 && wy < 300;
        for (int c = 0; c < 4; ++c) {
          ASSERT_EQ(component(image, x, y, c), inside ? component(whole, wx, wy, c) : 0)
              << name << " " << x << ", " << y;
        }
      }
    }
  };
  moved("t03.exr", 30, 20);
  moved("t05.exr", 30, 20);
  moved("t09.exr", 400, 0);
  moved("t13.exr", 399, 299);
  moved("t15.exr", -40, -40);
  EXPECT_EQ(read("display_window/t15.exr").pixel_aspect, 1.5);
}

TEST_F(ImageData, EveryViewOfAStereoFileIsTheSameInOnePartAndInMany) {
  const std::string single = root_ + "/sequence/beachball/singlepart.0001.exr",
                    multi = root_ + "/sequence/beachball_multipart/multipart.0001.exr";
  std::vector<Image> views;
  for (const char* view : {"left", "right"}) {
    ASSERT_OK_AND_ASSIGN(const Image one, read_image(single, {}, {.view = view}));
    ASSERT_OK_AND_ASSIGN(Image many, read_image(multi, {}, {.view = view}));
    EXPECT_TRUE(same_pixels(one, many)) << view;
    views.push_back(std::move(many));
  }
  EXPECT_FALSE(same_pixels(views[0], views[1]));
}

TEST_F(ImageData, EveryViewAndPartIsListedAndCanBeChosen) {
  const std::string path = root_ + "/exr/Adjuster.exr";
  ASSERT_OK_AND_ASSIGN(FileFacts facts, describe_image(path));
  EXPECT_EQ(facts.parts[0].views.size(), 3u);
  for (const std::string& view : facts.parts[0].views) {
    EXPECT_OK(read_image(path, {}, {.view = view})) << view;
  }
  const std::string multi = root_ + "/sequence/beachball_multipart/multipart.0001.exr";
  ASSERT_OK_AND_ASSIGN(facts, describe_image(multi));
  ASSERT_EQ(facts.parts.size(), 10u);
  for (const PartFacts& part : facts.parts) {
    // A part of motion vectors has two channels, which are no picture; each of them can be chosen.
    const absl::StatusOr<Image> image = read_image(multi, {}, {.part = part.name});
    EXPECT_EQ(image.ok(), part.channels.size() != 2) << part.name << ": " << image.status();
    for (const ChannelFacts& channel : part.channels) {
      EXPECT_OK(read_image(multi, {}, {.part = part.name, .layer = channel.name})) << channel.name;
    }
  }
}

TEST_F(ImageData, AMultiPartFileShowsWhatTheSinglePartOneDoes) {
  EXPECT_TRUE(same_pixels(read("sequence/beachball_multipart/multipart.0001.exr"),
                          read("sequence/beachball/singlepart.0001.exr")));
}

}  // namespace
}  // namespace candela
