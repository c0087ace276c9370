#include "tests/cli/images.h"

#include <gtest/gtest.h>
#include <half.h>

#include <cstring>
#include <sstream>

#include "client/image/image.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {

PngFacts png_facts(const std::string& path) {
  const std::string file = read_file(path);
  const auto word = [&file](size_t at) {
    uint32_t value = 0;
    for (size_t i = at; i < at + 4; ++i) value = value << 8 | static_cast<uint8_t>(file[i]);
    return value;
  };
  PngFacts facts;
  if (file.size() < 33 || file.compare(0, 8, "\x89PNG\r\n\x1a\n") != 0) return facts;
  facts.width = word(16);
  facts.height = word(20);
  facts.bits = file[24];
  facts.alpha = (file[25] & 4) != 0;
  for (size_t at = 8; at + 12 <= file.size(); at += 12 + word(at)) {
    // Pixels per unit: more of them across means narrower ones.
    if (file.compare(at + 4, 4, "pHYs") == 0) facts.pixel_aspect = double(word(at + 12)) / word(at + 8);
  }
  return facts;
}

std::vector<float> pfm_values(const std::string& path) {
  const std::string bytes = read_file(path);
  std::istringstream header(bytes);
  std::string kind, order;
  size_t width = 0;
  size_t height = 0;
  header >> kind >> width >> height >> order;
  std::vector<float> values(width * height * 3);
  const size_t size = values.size() * sizeof(float);
  EXPECT_EQ(kind, "PF");
  EXPECT_GE(bytes.size(), size);
  if (bytes.size() >= size) std::memcpy(values.data(), bytes.data() + bytes.size() - size, size);
  return values;
}

void write_small_exr(const std::string& path, bool alpha_and_aspect) {
  Image image = *make_image(31, 17, ImageFormat::kRgba16f);
  std::byte* to = image.pixels.data();
  for (uint32_t y = 0; y < image.height; ++y) {
    for (uint32_t x = 0; x < image.width; ++x, to += 8) {
      const float light = x % 7 == 3 && y % 5 == 2 ? 40.0f : 0.02f * static_cast<float>(x + y);
      const float alpha = alpha_and_aspect ? static_cast<float>(x % 3) / 2 : 1.0f;
      const half pixel[] = {half(light), half(0.7f * light), half(0.2f), half(alpha)};
      std::memcpy(to, pixel, sizeof pixel);
    }
  }
  image.has_alpha = alpha_and_aspect;
  if (alpha_and_aspect) image.pixel_aspect = 2;
  ASSERT_OK_AND_ASSIGN(const auto notes, write_image(path, image));
}

}  // namespace candela
