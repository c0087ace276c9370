#include "client/cli/options/picture/size_options.h"

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/words/option_kinds.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {

// "480x270", "480x", "x270" or "50%".
absl::Status set_resize(v1::Settings& settings, const std::string& text) {
  const absl::Status wrong = usage_error(absl::StrFormat(
      "--resize is \"%s\"; it must be WIDTHxHEIGHT, WIDTHx or xHEIGHT, with sides of 1 .. %d pixels, or a "
      "percentage above 0 and at most %s, such as 50%%",
      text, v1::kMaxDimension, v1::format_number(v1::kMaxOutputPercent)));
  v1::OutputSize& size = *settings.mutable_output_size();
  size.clear_width();
  size.clear_height();
  size.clear_percent();
  if (absl::EndsWith(text, "%")) {
    double percent = 0;
    const bool good = absl::SimpleAtod(absl::StripSuffix(text, "%"), &percent) && percent > 0 &&
                      percent <= v1::kMaxOutputPercent;
    size.set_percent(percent);
    return good ? absl::OkStatus() : wrong;
  }
  const std::vector<std::string> sides = absl::StrSplit(text, absl::ByAnyChar("xX"));
  if (sides.size() != 2 || (sides[0].empty() && sides[1].empty())) return wrong;
  for (const size_t i : {0, 1}) {
    if (sides[i].empty()) continue;
    uint32_t pixels = 0;
    if (!absl::SimpleAtoi(sides[i], &pixels) || pixels < 1 || pixels > v1::kMaxDimension) return wrong;
    i == 0 ? size.set_width(pixels) : size.set_height(pixels);
  }
  return absl::OkStatus();
}

}  // namespace

void add_size_options(CLI::App& app, v1::Settings& settings, const v1::SettingField& setting) {
  const std::string& group = setting.declaration().group();
  add_text(app, group, "--resize", "WxH|Wx|xH|N%",
           absl::StrFormat(
               "%s, made in linear light, before the tone curve: both sides, one of them while the "
               "other follows from the frame's shape, or percent of both; 1 .. %d pixels, above 0 "
               ".. %s %% (default: the frame's). Exposure and bloom are the frame's",
               setting.declaration().help(), v1::kMaxDimension, v1::format_number(v1::kMaxOutputPercent)),
           [&settings](const std::string& text) { return set_resize(settings, text); });
  const v1::Range<double> range{1, double{v1::kMaxDimension}};
  add_text(
      app, group, "--max-size", "N",
      absl::StrFormat("Make the longer side N pixels, as --resize does; a frame that is no larger keeps its "
                      "pixels; %s (default: no limit)",
                      format_range(range)),
      [&settings, range](const std::string& text) {
        const absl::StatusOr<double> side = parse_number("--max-size", text, range, true);
        if (side.ok()) settings.mutable_output_size()->set_max_side(static_cast<uint32_t>(*side));
        return side.status();
      });
}

void add_desqueeze_option(CLI::App& app, PictureOptions& options) {
  app.add_flag(
         "--desqueeze", options.desqueeze,
         "Make square pixels of an anamorphic file's: its pixel aspect (of OpenEXR pixelAspectRatio) widens "
         "the image, as --resize does. Without it the image's pixels have the file's aspect, and say so")
      ->group(kOutputSection);
}

absl::Status check_size_options(const v1::Settings& settings) {
  const v1::OutputSize& size = settings.output_size();
  if (size.max_side() > 0 && (size.width() > 0 || size.height() > 0 || size.has_percent())) {
    return usage_error("--resize and --max-size both say the image's size; give only one of them");
  }
  return absl::OkStatus();
}

}  // namespace candela
