// Checks a file's primaries and pixel aspect, and counts its missing pixels, for all readers.
#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/base/number_words.h"
#include "client/image/primaries.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

// Whether the primaries span a plane and can be mixed to white.
bool has_matrix(const std::array<float, 8>& xy) {
  for (float v : xy) {
    // Real encodings, even with imaginary primaries, stay within a few units.
    if (!std::isfinite(v) || std::fabs(v) > 1e3f) return false;
  }
  const auto cross = [&](int a, int b, int c) {  // twice the area of the triangle a b c
    const double ax = xy[2 * a], ay = xy[2 * a + 1];
    return (xy[2 * b] - ax) * (xy[2 * c + 1] - ay) - (xy[2 * c] - ax) * (xy[2 * b + 1] - ay);
  };
  constexpr int kRed = 0, kGreen = 1, kBlue = 2, kWhite = 3;
  constexpr double kTiny = 1e-6;
  return std::fabs(cross(kRed, kGreen, kBlue)) > kTiny && std::fabs(xy[7]) > kTiny &&
         // If white is on a side of the triangle, one primary has no share in it.
         std::fabs(cross(kWhite, kGreen, kBlue)) > kTiny && std::fabs(cross(kRed, kWhite, kBlue)) > kTiny &&
         std::fabs(cross(kRed, kGreen, kWhite)) > kTiny;
}

}  // namespace

absl::Status or_fill(const absl::Status& status) {
  return {status.code(), absl::StrCat(status.message(), "; --incomplete fill renders what is there")};
}

void note_missing(const std::string& path, const absl::Status& why, uint64_t missing, Image& image) {
  image.notes.push_back(absl::StrFormat("%s: %d of its %d pixels are missing and absent, with alpha 0",
                                        absl::StripPrefix(why.message(), path + ": "), missing,
                                        uint64_t{image.width} * image.height));
  image.missing_pixels = missing;
  image.has_alpha = true;
}

void set_chromaticities(const std::array<float, 8>& xy, Image& image) {
  image.chromaticities.reset();
  if (!has_matrix(xy)) {
    image.notes.push_back(
        "the file's chromaticities are singular and were ignored; its colours are taken as Rec.709");
    return;
  }
  image.names_primaries = true;
  const bool rec709 = std::equal(xy.begin(), xy.end(), kRec709.xy.begin(),
                                 [](float a, float b) { return std::fabs(a - b) <= 1e-4f; });
  if (!rec709) image.chromaticities = xy;
}

void set_pixel_aspect(double aspect, Image& image) {
  if (std::isfinite(aspect) && aspect >= 0.01 && aspect <= 100) {
    image.pixel_aspect = aspect;
  } else {
    image.notes.push_back(absl::StrFormat(
        "the file's pixel aspect of %s is not within 0.01 .. 100 and was ignored", in_digits(aspect, 6)));
  }
}

}  // namespace candela
