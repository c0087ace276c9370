#include "client/cli/commands/render/gamut_note.h"

#include "absl/strings/str_format.h"
#include "client/base/number_words.h"

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
      return kCheck;
    case v1::TONE_CURVE_TABLE:
      return settings.table().axes() == v1::ColorTable::AXES_REC709 ? "the view works on Rec.709's channels"
                                                                    : kCheck;
    case v1::TONE_CURVE_UNSPECIFIED:
    case v1::TONE_CURVE_ACES_HILL:
    case v1::TONE_CURVE_AGX:
      return "--curve aces-1 keeps all of ACES AP1";
    default:
      return "the curve works on Rec.709's channels; --curve aces-1 keeps all of ACES AP1";
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

}  // namespace candela
