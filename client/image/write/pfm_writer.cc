// Writes PFM: RGB floats, little endian, rows from the bottom.
#include <half.h>

#include <cstring>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/number_words.h"
#include "client/image/write/writers.h"

namespace candela {

absl::Status write_pfm(AtomicFile& file, const Image& image, const WriteOptions&, Notes& notes) {
  const std::string header = absl::StrFormat("PF\n%d %d\n-1.0\n", image.width, image.height);
  file.write(header.data(), header.size());
  std::vector<float> row(size_t{3} * image.width);
  for (uint32_t y = image.height; y-- > 0;) {
    const std::byte* from = image.pixels.data() + y * image.row_bytes();
    for (size_t x = 0; x < image.width; ++x) {
      if (image.format == ImageFormat::kRgba32f) {
        std::memcpy(&row[3 * x], from + 16 * x, 12);
        continue;
      }
      uint16_t bits[3];
      std::memcpy(bits, from + 8 * x, sizeof bits);
      for (size_t c = 0; c < 3; ++c) row[3 * x + c] = imath_half_to_float(bits[c]);
    }
    file.write(row.data(), row.size() * sizeof(float));  // commit() reports failures
  }
  if (image.pixel_aspect != 1.0) {
    notes.push_back(
        absl::StrFormat("pixel aspect %s dropped: .pfm has none", in_digits(image.pixel_aspect, 6)));
  }
  return absl::OkStatus();
}

}  // namespace candela
