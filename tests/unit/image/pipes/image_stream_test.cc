#include "client/image/read/image_stream.h"

#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <gtest/gtest.h>
#include <half.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png_bytes.h"

namespace candela {
namespace {

struct Pipe {
  Pipe() { EXPECT_EQ(pipe(ends), 0); }
  int ends[2] = {};
};

// A pipe that these bytes come through.
class Fed {
 public:
  explicit Fed(const std::string& bytes)
      : writer_([this, bytes] {
          for (size_t at = 0; at < bytes.size();) {
            const ssize_t count =
                write(pipe_.ends[1], bytes.data() + at, std::min<size_t>(bytes.size() - at, 777));
            if (count <= 0) break;
            at += static_cast<size_t>(count);
          }
          close(pipe_.ends[1]);
        }) {}
  ~Fed() {
    close(pipe_.ends[0]);
    writer_.join();
  }
  int descriptor() const { return pipe_.ends[0]; }

 private:
  const Pipe pipe_;
  std::thread writer_;
};

std::string phm(const std::string& head, std::initializer_list<float> values, bool swap = false) {
  std::string text = head;
  for (const float value : values) {
    const uint16_t bits = half(value).bits();
    text.push_back(static_cast<char>(swap ? bits >> 8 : bits));
    text.push_back(static_cast<char>(swap ? bits : bits >> 8));
  }
  return text;
}

std::string pfm(const std::string& head, const std::vector<float>& values) {
  std::string text = head;
  text.append(reinterpret_cast<const char*>(values.data()), 4 * values.size());
  return text;
}

class ImageStreams : public ::testing::Test {
 protected:
  ImageStreams() { std::signal(SIGPIPE, SIG_IGN); }

  // All images of the stream, or the first failure.
  absl::StatusOr<std::vector<Image>> read(const std::string& bytes, const ImageLimits& limits = {},
                                          const PictureChoice& choice = {}) {
    const Fed fed(bytes);
    ImageStream stream(fed.descriptor(), "pipe", limits, choice);
    std::vector<Image> images;
    while (std::optional<absl::StatusOr<Image>> image = stream.next()) {
      if (!image->ok()) return image->status();
      images.push_back(*std::move(*image));
    }
    EXPECT_OK(stream.lost());
    return images;
  }
  std::string failure(const std::string& bytes, const ImageLimits& limits = {}) {
    return std::string(read(bytes, limits).status().message());
  }
  std::string exr(const std::string& name) const { return read_file(folder_.path(name)); }

  const TemporaryFolder folder_;
};

TEST_F(ImageStreams, FilesOneAfterAnotherAreThoseFiles) {
  std::vector<std::string> names;
  const auto name = [&] { return folder_.path(names.emplace_back(std::to_string(names.size()) + ".exr")); };
  for (int c = 0; c < Imf::NUM_COMPRESSION_METHODS; ++c) {
    Imf::Header header(45, 67);
    header.compression() = static_cast<Imf::Compression>(c);
    write_scan_lines(name(), header, rgb_channels());
    write_tiles(name(), header, Imf::TileDescription(16, 24), rgb_channels(), 0);
  }
  for (const auto mode : {Imf::MIPMAP_LEVELS, Imf::RIPMAP_LEVELS}) {
    for (const auto round : {Imf::ROUND_DOWN, Imf::ROUND_UP}) {
      write_tiles(name(), Imf::Header(45, 19), Imf::TileDescription(8, 4, mode, round), rgb_channels(), 0);
    }
  }
  Imf::Header upwards(Imath::Box2i({-3, 5}, {12, 64}), Imath::Box2i({-20, -30}, {20, 30}));
  upwards.lineOrder() = Imf::DECREASING_Y;
  write_scan_lines(name(), upwards, rgb_channels());
  std::string all;
  for (const std::string& file : names) all += exr(file);
  names.push_back("last.pfm");
  write_file(folder_.path("last.pfm"), pfm("PF\n2 1\n-1\n", {1, 2, 3, 4, 5, 6}));
  all += exr("last.pfm");
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> images, read(all));
  ASSERT_EQ(images.size(), names.size());
  for (size_t i = 0; i < names.size(); ++i) {
    ASSERT_OK_AND_ASSIGN(const Image file, read_image(folder_.path(names[i])));
    EXPECT_TRUE(same_pixels(images[i], file)) << i;
  }
}

TEST_F(ImageStreams, APhmComesFromTheTopAndAPfmFromBelow) {
  const std::string halves = phm("PH\n1 2\n-1.000000\n", {1, 2, 3, 4, 5, 6}),
                    big = phm("PH\n1 2\n1.000000\n", {1, 2, 3, 4, 5, 6}, true),
                    grey = phm("Ph\n2 1\n-1.000000\n", {7, 8}), doubled = phm("PH\n1 1\n-2\n", {1, 2, 3}),
                    floats = pfm("PF\n1 2\n-1\n", {1, 2, 3, 4, 5, 6});
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> images, read(halves + big + grey + doubled + floats));
  ASSERT_EQ(images.size(), 5u);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(images[i].format, ImageFormat::kRgba16f);
    EXPECT_EQ(component(images[i], 0, 0, 0), 1);
    EXPECT_EQ(component(images[i], 0, 1, 2), 6);
    EXPECT_EQ(component(images[i], 0, 1, 3), 1);
  }
  EXPECT_EQ(component(images[2], 1, 0, 1), 8);
  EXPECT_EQ(images[3].format, ImageFormat::kRgba32f);
  EXPECT_EQ(component(images[3], 0, 0, 2), 6);
  EXPECT_EQ(component(images[4], 0, 0, 0), 4);
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> top, read(floats, {}, {.rows = RowOrder::kTop}));
  EXPECT_EQ(component(top[0], 0, 0, 0), 1);
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> low, read(halves, {}, {.rows = RowOrder::kBottom}));
  EXPECT_EQ(component(low[0], 0, 0, 0), 4);
  write_file(folder_.path("a.phm"), halves);
  ASSERT_OK_AND_ASSIGN(const Image file, read_image(folder_.path("a.phm")));
  EXPECT_TRUE(same_pixels(file, images[0]));
}

TEST_F(ImageStreams, PixelsThatLookLikeAHeaderAreNone) {
  std::string all;
  for (const char* head :
       {"PF\n1 1\n-1\n", "PF\r\n1 1\r\n-1\r\n", "PF 1 1 -1 ", "PF\n# a comment\n1 1\n-1\n"}) {
    for (const char* first : {"\n", "\r", " ", "#"}) {
      all += head + std::string(first) + std::string("\0\0\x3f", 3) + pfm("", {2, 3});
    }
  }
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> images, read(all));
  EXPECT_EQ(images.size(), 16u);
  for (const Image& image : images) EXPECT_EQ(component(image, 0, 0, 2), 3);
}

TEST_F(ImageStreams, ABrokenFrameIsNamedByItsNumber) {
  const std::string good = pfm("PF\n1 1\n-1\n", {1, 2, 3});
  EXPECT_EQ(failure(good + good + "what?"),
            "pipe, frame 3: here no PFM, PHM, PNG, OpenEXR or y4m begins, so what follows cannot be read");
  EXPECT_EQ(failure(good + good.substr(0, good.size() - 1)),
            "pipe, frame 2: the file is truncated: 1 of 12 bytes of pixels is missing");
  EXPECT_EQ(failure("PF"),
            "pipe, frame 1: its PFM header is not 'PF', 'PF4' or 'Pf', width, height and "
            "scale, each followed by white space");
  EXPECT_EQ(failure("P"), "pipe, frame 1: not an OpenEXR, Radiance, PFM, PNG, AVIF or JPEG file");
  EXPECT_TRUE(failure(good + "PF\n#" + std::string(9999, ' ')).starts_with("pipe, frame 2: its PFM header"));
  EXPECT_TRUE(
      failure("#?RADIANCE\n").starts_with("pipe, frame 1: a Radiance file does not say where it ends"));
  write_scan_lines(folder_.path("a.exr"), Imf::Header(20, 40), rgb_channels());
  write_deep(folder_.path("deep.exr"));
  const std::string file = exr("a.exr");
  EXPECT_TRUE(failure(good + exr("deep.exr")).starts_with("pipe, frame 2: an OpenEXR file of several parts"));
  for (const size_t cut : {size_t{1}, file.size() / 2, file.size() - 9, file.size() - 400}) {
    EXPECT_TRUE(failure(good + file.substr(0, file.size() - cut)).starts_with("pipe, frame 2: ")) << cut;
  }
}

TEST_F(ImageStreams, LimitsHoldBeforeMemoryIsTaken) {
  EXPECT_TRUE(
      failure("PF\n99999 1\n-1\n").starts_with("pipe, frame 1: the image is 99999x1 pixels; the limit"));
  EXPECT_TRUE(failure("PF\n9000 9000\n-1\n").find("the limit is 536870912 bytes") != std::string::npos);
  write_scan_lines(folder_.path("a.exr"), Imf::Header(20, 40), rgb_channels());
  std::string file = exr("a.exr");
  EXPECT_TRUE(failure(file, {.max_chunk_bytes = 100}).find("--max-chunk-mib allows 100") !=
              std::string::npos);
  EXPECT_TRUE(failure(file, {.max_bytes = 6400, .max_pixels = 799}).find("--max-pixels allows 799") !=
              std::string::npos);
  // An attribute that claims a gigabyte.
  const size_t at = file.find("compression") + 24;
  const uint32_t claimed = 1u << 30;
  std::memcpy(file.data() + at, &claimed, 4);
  EXPECT_TRUE(failure(file).starts_with("pipe, frame 1: damaged OpenEXR file: attribute compression claims"));
}

TEST_F(ImageStreams, PngsComeOneAfterAnother) {
  const std::string grey = png_of(3, 8, 0, "abc"), wide = png_of(1, 16, 2, "abcdef", cicp(9, 16));
  const std::string frame = pfm("PF\n1 1\n-1\n", {1, 2, 3});
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> images, read(grey + wide + frame + grey));
  ASSERT_EQ(images.size(), 4u);
  const std::string* const files[] = {&grey, &wide, &frame, &grey};
  for (size_t i = 0; i < images.size(); ++i) {
    ASSERT_OK_AND_ASSIGN(const Image file, read_image_bytes("file", *files[i]));
    EXPECT_TRUE(same_pixels(images[i], file)) << i;
    EXPECT_EQ(images[i].display_light, i == 1);
  }
  // Wherever the stream ends, it is that frame which is cut. All its pixels are before IEND.
  for (size_t size = 1; size < grey.size() - 16; ++size) {
    EXPECT_TRUE(failure(wide + grey.substr(0, size)).starts_with("pipe, frame 2: ")) << size;
  }
  EXPECT_EQ(failure(grey + "\x89PNG\r\n\x1a\r" + grey),
            "pipe, frame 2: damaged PNG file: its first 8 bytes are not those of a PNG");
  EXPECT_EQ(failure(grey.substr(0, 8) + chunk("IDAT", "") + grey),
            "pipe, frame 1: damaged PNG file: it begins without IHDR");
  // Limits hold before memory is taken.
  const auto sized = [&](uint32_t width, uint32_t height) {
    return grey.substr(0, 8) +
           chunk("IHDR", big_endian(width) + big_endian(height) + std::string("\x8\0\0\0\0", 5));
  };
  EXPECT_TRUE(failure(sized(0, 1)).find("it must be at least 1x1") != std::string::npos);
  EXPECT_TRUE(failure(sized(0xffffffff, 1)).find("4294967295x1 pixels; the limit is") != std::string::npos);
  EXPECT_TRUE(failure(sized(9000, 9000)).find("the limit is 536870912 bytes") != std::string::npos);
  EXPECT_TRUE(failure(sized(1, 1) + big_endian(0xffffffff) + "IDAT")
                  .find("it takes more than the 2147483648 bytes") != std::string::npos);
  // A damaged frame whose end is known does not end the stream.
  std::string damaged = grey;
  damaged[damaged.find("IDAT") + 6] ^= 1;
  const Fed fed(grey + damaged + grey);
  ImageStream stream(fed.descriptor(), "pipe", {}, {});
  EXPECT_OK(stream.next()->status());
  EXPECT_TRUE(says(stream.next()->status().message(), "pipe, frame 2: damaged PNG file: "));
  EXPECT_OK(stream.next()->status());
  EXPECT_FALSE(stream.next().has_value());
}

TEST_F(ImageStreams, RealFilesAreTheSameThroughAPipe) {
  if (data_folder().empty()) GTEST_SKIP() << "there is no test data";
  size_t streamed = 0;
  for (const char* folder : {"exr", "compression", "display_window", "radiance", "sequence", "bad"}) {
    for (const std::string& name : data_files(folder)) {
      const std::string bytes = read_file(name);
      const absl::StatusOr<Image> file = read_image(name);
      {
        const Fed fed(bytes);
        const absl::StatusOr<Image> piped = read_piped_image(fed.descriptor(), "pipe", {}, {});
        ASSERT_EQ(piped.ok(), file.ok()) << name << piped.status() << file.status();
        if (file.ok()) {
          EXPECT_TRUE(same_pixels(*piped, *file)) << name;
        }
      }
      const Fed fed(bytes + bytes);
      ImageStream stream(fed.descriptor(), "pipe", {}, {});
      for (int i = 0; i < 2; ++i) {
        const std::optional<absl::StatusOr<Image>> image = stream.next();
        if (absl::IsUnimplemented(stream.lost())) break;  // several parts, or Radiance
        ASSERT_TRUE(image.has_value()) << name;
        if (file.ok()) {
          ASSERT_OK(image->status()) << name;
        }
        if (!image->ok()) break;
        if (file.ok()) {
          EXPECT_TRUE(same_pixels(**image, *file)) << name;
        }
        ++streamed;
      }
    }
  }
  EXPECT_GT(streamed, 60u);
}

TEST_F(ImageStreams, AnEmptyStreamIsNoImage) {
  const Fed none("");
  EXPECT_EQ(read_piped_image(none.descriptor(), "pipe", {}, {}).status().message(),
            "pipe: the file is empty");
}

TEST_F(ImageStreams, AStreamThatIsStoppedWhileItWaitsEnds) {
  const Pipe pipe;
  ImageStream stream(pipe.ends[0], "pipe", {}, {});
  std::thread stops([&stream] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    stream.stop();
  });
  EXPECT_FALSE(stream.next().has_value());
  stops.join();
  close(pipe.ends[0]);
  close(pipe.ends[1]);
}

}  // namespace
}  // namespace candela
