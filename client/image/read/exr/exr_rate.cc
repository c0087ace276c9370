#include "client/image/read/exr/exr_rate.h"

#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfFloatAttribute.h>
#include <OpenEXR/ImfFramesPerSecond.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfRationalAttribute.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfVecAttribute.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

namespace candela {
namespace {

constexpr char kName[] = "framesPerSecond";
// Of the whole numbers in a rational that OpenEXR can write again.
constexpr double kMostWhole = std::numeric_limits<int>::max();

// Frames in so many seconds. Written so that NaN gives nothing.
std::optional<FrameRate> rate_from(double frames, double seconds) {
  const auto whole = [](double number) {
    return number >= 1 && number <= kMostWhole && number == std::floor(number);
  };
  if (whole(frames) && whole(seconds)) {
    return FrameRate{static_cast<uint64_t>(frames), static_cast<uint64_t>(seconds)};
  }
  const Imf::Rational rate = Imf::guessExactFps(frames / seconds);
  if (rate.n <= 0 || rate.d == 0) return std::nullopt;
  return FrameRate{static_cast<uint64_t>(rate.n), rate.d};
}

std::optional<FrameRate> rate_from(absl::string_view text) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, '/');
  double frames = 0, seconds = 1;
  const bool numbers =
      parts.size() <= 2 && absl::SimpleAtod(absl::StripAsciiWhitespace(parts[0]), &frames) &&
      (parts.size() == 1 || absl::SimpleAtod(absl::StripAsciiWhitespace(parts[1]), &seconds));
  return numbers ? rate_from(frames, seconds) : std::nullopt;
}

template <typename Number>
std::optional<FrameRate> rate_from_number(const Imf::Attribute& attribute) {
  const auto* typed = dynamic_cast<const Imf::TypedAttribute<Number>*>(&attribute);
  return typed == nullptr ? std::nullopt : rate_from(static_cast<double>(typed->value()), 1);
}

template <typename Pair>
std::optional<FrameRate> rate_from_pair(const Imf::Attribute& attribute) {
  const auto* typed = dynamic_cast<const Imf::TypedAttribute<Pair>*>(&attribute);
  if (typed == nullptr) return std::nullopt;
  return rate_from(static_cast<double>(typed->value().x), static_cast<double>(typed->value().y));
}

std::optional<FrameRate> rate_from(const Imf::Attribute& attribute) {
  if (const auto* typed = dynamic_cast<const Imf::RationalAttribute*>(&attribute)) {
    return rate_from(typed->value().n, typed->value().d);
  }
  if (const auto* typed = dynamic_cast<const Imf::StringAttribute*>(&attribute)) {
    return rate_from(absl::string_view(typed->value()));
  }
  for (const auto& read :
       {rate_from_number<int>, rate_from_number<float>, rate_from_number<double>, rate_from_pair<Imath::V2i>,
        rate_from_pair<Imath::V2f>, rate_from_pair<Imath::V2d>}) {
    if (const std::optional<FrameRate> rate = read(attribute)) return rate;
  }
  return std::nullopt;
}

}  // namespace

std::optional<FrameRate> frame_rate_of(const Imf::Header& header) {
  if (const auto own = header.find(kName); own != header.end()) {
    if (const std::optional<FrameRate> rate = rate_from(own.attribute())) return rate;
  }
  for (auto at = header.begin(); at != header.end(); ++at) {
    if (!absl::EqualsIgnoreCase(at.name(), kName)) continue;
    if (const std::optional<FrameRate> rate = rate_from(at.attribute())) return rate;
  }
  return std::nullopt;
}

}  // namespace candela
