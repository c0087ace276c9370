#include "client/run/images/contact_sheet.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/run/images/sheet_font.h"
#include "proto/candela/v1/limits.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr uint32_t kGap = 12, kDot = 2;  // pixels: between cells, and a letter's dot
constexpr uint32_t kLine = (kLetterHeight + 1) * kDot, kWords = 2 * (kLine + kDot);
constexpr uint32_t kLeastCell = 22 * kLetterWidth * kDot;  // "frame 1001  +12.34 EV"
constexpr uint8_t kBackground = 32, kNameInk = 224, kWordsInk = 160;

// "shot_v012.0001.exr" in 12 letters is "shot_..1.exr".
std::string cut_to(const std::string& text, size_t letters) {
  if (text.size() <= letters) return text;
  const size_t begin = (letters - 2) / 2;
  return text.substr(0, begin) + ".." + text.substr(text.size() - (letters - 2 - begin));
}

class Sheet {
 public:
  explicit Sheet(Image image) : image_(std::move(image)) {
    fill(0, 0, image_.width, image_.height, kBackground);
  }
  Image take() && { return std::move(image_); }

  void put(const Image& picture, uint32_t x, uint32_t y) {
    for (uint32_t row = 0; row < picture.height; ++row) {
      std::memcpy(at(x, y + row), picture.pixels.data() + row * picture.row_bytes(), picture.row_bytes());
    }
    for (uint32_t row = 0; row < picture.height; ++row) {
      for (uint32_t i = 0; i < picture.width; ++i) at(x + i, y + row)[3] = std::byte{255};
    }
  }

  void write(const std::string& text, uint32_t x, uint32_t y, uint8_t ink) {
    for (const char c : text) {
      for (uint32_t column = 0; column < kLetterWidth; ++column) {
        for (uint32_t row = 0; row < kLetterHeight; ++row) {
          if ((letter(c)[column] >> row & 1) != 0) fill(x + column * kDot, y + row * kDot, kDot, kDot, ink);
        }
      }
      x += kLetterWidth * kDot;
    }
  }

 private:
  std::byte* at(uint32_t x, uint32_t y) {
    return image_.pixels.data() + y * image_.row_bytes() + size_t{4} * x;
  }
  void fill(uint32_t x, uint32_t y, uint32_t width, uint32_t height, uint8_t code) {
    for (uint32_t row = y; row < y + height; ++row) {
      for (uint32_t i = x; i < x + width; ++i) {
        std::fill_n(at(i, row), 3, std::byte{code});
        at(i, row)[3] = std::byte{255};
      }
    }
  }

  Image image_;
};

}  // namespace

absl::StatusOr<Image> make_contact_sheet(const std::vector<SheetPicture>& pictures, uint32_t columns) {
  uint32_t wide = kLeastCell, high = 1;
  for (const SheetPicture& one : pictures) {
    wide = std::max(wide, one.picture.width);
    high = std::max(high, one.picture.height);
  }
  if (columns == 0) {
    const auto side = static_cast<uint32_t>(std::ceil(std::sqrt(static_cast<double>(pictures.size()))));
    columns = std::min(side, std::max(1u, (v1::kMaxDimension - kGap) / (wide + kGap)));
  }
  columns = std::min(columns, static_cast<uint32_t>(pictures.size()));
  const uint64_t rows = (pictures.size() + columns - 1) / columns;
  const uint64_t width = kGap + uint64_t{columns} * (wide + kGap),
                 height = kGap + rows * (uint64_t{high} + kWords + kGap);
  if (std::max(width, height) > v1::kMaxDimension) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "a sheet of %d pictures in %d columns is %dx%d, and %d is the most; make smaller pictures, or "
        "several sheets",
        pictures.size(), columns, width, height, v1::kMaxDimension));
  }
  ASSIGN_OR_RETURN(Image image, image_to_overwrite(static_cast<uint32_t>(width),
                                                   static_cast<uint32_t>(height), ImageFormat::kRgba8));
  Sheet sheet(std::move(image));
  const size_t letters = wide / (kLetterWidth * kDot);
  for (size_t i = 0; i < pictures.size(); ++i) {
    const auto x = static_cast<uint32_t>(kGap + i % columns * (wide + kGap));
    const auto y = static_cast<uint32_t>(kGap + i / columns * (high + kWords + kGap));
    const SheetPicture& one = pictures[i];
    sheet.put(one.picture, x + (wide - one.picture.width) / 2, y + high - one.picture.height);
    sheet.write(cut_to(one.name, letters), x, y + high + 2 * kDot, kNameInk);
    sheet.write(cut_to(one.words, letters), x, y + high + 2 * kDot + kLine, kWordsInk);
  }
  return std::move(sheet).take();
}

}  // namespace candela
