#include "client/run/picture/frame_notes.h"

#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/number_words.h"
#include "proto/candela/v1/settings.h"

namespace candela {
namespace {

constexpr double kNotedShare = 0.01;

// Light outside of ACES AP1, the largest gamut that a curve has.
constexpr char kCheck[] =
    "no display shows them; if the picture should have none, name the file's primaries with --primaries";

// Tells the user how to keep the colours.
const char* advice(const v1::Settings& settings) {
  switch (settings.curve()) {
    case v1::TONE_CURVE_ACES_1:
    case v1::TONE_CURVE_ACES_2:
      return kCheck;
    case v1::TONE_CURVE_TABLE:
      return settings.table().axes() == v1::ColorTable::AXES_REC709 ? "the view works on Rec.709's channels"
                                                                    : kCheck;
    case v1::TONE_CURVE_UNSPECIFIED:
    case v1::TONE_CURVE_ACES_HILL:
    case v1::TONE_CURVE_AGX:
      return "--curve aces-2 keeps all of ACES AP1";
    default:
      return "the curve works on Rec.709's channels; --curve aces-2 keeps all of ACES AP1";
  }
}

}  // namespace

std::optional<std::string> gamut_note(const v1::ResultHeader& result, const v1::Settings& settings) {
  const double components = 3.0 * result.width() * result.height();
  const double share = static_cast<double>(result.gamut_cut_components()) / components;
  if (!(share > kNotedShare)) return std::nullopt;
  return absl::StrFormat("%s %% of the colour components lie outside the curve's gamut and were cut; %s",
                         in_digits(100.0 * share, 2), advice(settings));
}

std::string held_words(double target, double target_before_limits) {
  if (target_before_limits == 0 || target == target_before_limits) return "";
  const bool above = target < target_before_limits;
  return absl::StrFormat("exposure held at %s %s; it would have been %s%s",
                         above ? "--max-exposure" : "--min-exposure", v1::format_number(target),
                         in_digits(target_before_limits, 4),
                         above ? "; --ignore-below 0.01 leaves a black background out of the metering" : "");
}

std::string bad_values_note(uint64_t nan, uint64_t infinite, uint64_t clamped) {
  std::vector<std::string> words;
  if (nan + infinite > 0) {
    words.push_back(
        absl::StrFormat("%d NaN and %d infinite components were taken as 0 and +-65504", nan, infinite));
  }
  if (clamped > 0) {
    words.push_back(absl::StrFormat("%d component%s beyond 2^30, the most that is rendered, %s cut to that",
                                    clamped, clamped == 1 ? "" : "s", clamped == 1 ? "was" : "were"));
  }
  return absl::StrJoin(words, "; ");
}

std::string cube_map_note(const Image& image) {
  if (!image.is_cube_map) return "";
  return "the file is a cube map (envmap): its faces are rendered as they lie in it; candela view and "
         "candela environment show what they surround";
}

}  // namespace candela
