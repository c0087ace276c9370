// An OpenEXR file that a test writes and reads back.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "client/image/image.h"
#include "tests/support/files.h"

namespace candela {

class ExrReader : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  const std::string path_ = folder_.path("in.exr");

  // The file's image. Fails the test if it cannot be read.
  Image read(const ImageLimits& limits = {}) {
    absl::StatusOr<Image> image = read_image(path_, limits);
    EXPECT_TRUE(image.ok()) << image.status();
    return image.ok() ? *std::move(image) : Image{};
  }
  // The error of reading the file, or "read" if there is none.
  std::string error(const ImageLimits& limits = {}) {
    absl::StatusOr<Image> image = read_image(path_, limits);
    return image.ok() ? "read" : image.status().ToString();
  }
};

}  // namespace candela
