#include "client/cli/options/picture/view_options.h"

#include <algorithm>
#include <cstdlib>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/words/option_kinds.h"
#include "client/color/view_table.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr char kVariable[] = "OCIO";  // OpenColorIO's own

// With --lut the view is that of a LUT.
absl::Status take_lut(PictureOptions& options) {
  ViewChoice& view = options.view;
  if (options.lut.empty()) {
    if (view.lut_input.empty() && !view.lut_domain) return absl::OkStatus();
    return usage_error(absl::StrFormat("%s says what a LUT takes; name one with --lut FILE",
                                       view.lut_domain ? "--lut-domain" : "--lut-input"));
  }
  for (const auto& [name, value] :
       {std::pair("--ocio", view.config), std::pair("--display", view.display),
        std::pair("--ocio-view", view.view), std::pair("--ocio-input", view.input)}) {
    if (!value.empty()) return usage_error(absl::StrFormat("--lut is a view by itself; leave out %s", name));
  }
  view.config = options.lut;
  view.source = "--lut";
  if (view.lut_input.empty()) view.lut_input = lut_inputs().front();
  return absl::OkStatus();
}

absl::Status take_domain(const std::string& text, ViewChoice& view) {
  ASSIGN_OR_RETURN(const auto values, parse_list("--lut-domain", text, 2, {-65504, 65504}));
  if (!(values[0] < values[1])) {
    return usage_error(absl::StrFormat("--lut-domain is \"%s\"; the first must be below the second", text));
  }
  view.lut_domain = std::pair(values[0], values[1]);
  return absl::OkStatus();
}

}  // namespace

void add_view_options(CLI::App& app, PictureOptions& options) {
  ViewChoice& view = options.view;
  const auto add = [&](const char* name, const char* placeholder, const char* help, std::string& to) {
    add_text(app, kToneSection, name, placeholder, help, to);
  };
  add("--ocio", "CONFIG",
      "Instead of a curve: a view of this OpenColorIO configuration, at 0 EV and without bloom unless their "
      "options are given (default: $OCIO)",
      view.config);
  add("--display", "NAME", "Display of --ocio (default: the configuration's)", view.display);
  add("--ocio-view", "NAME", "View of --ocio (default: the display's)", view.view);
  add("--ocio-input", "NAME",
      "Colour space of --ocio that the file's values are in, whatever "
      "the file says (default: light of the file's primaries)",
      view.input);
  add("--lut", "FILE",
      "Instead of a curve: this LUT (.cube, .clf, .ctf, .spi1d, .spi3d, .3dl and others), at 0 EV and "
      "without bloom unless "
      "their options are given",
      options.lut);
  add_text(app, kToneSection, "--lut-input", "NAME",
           absl::StrFormat("Values that the LUT takes: %s (default %s, of Rec.709)",
                           absl::StrJoin(lut_inputs(), ", "), lut_inputs().front()),
           [&view](const std::string& word) {
             const std::vector<std::string> words = lut_inputs();
             if (std::ranges::count(words, word) == 0) return unknown_word("--lut-input", word, words);
             view.lut_input = word;
             return absl::OkStatus();
           });
  add_text(
      app, kToneSection, "--lut-domain", "LOW,HIGH",
      "Values at the ends of a LUT whose file does not say them, such as -10,6 stops with --lut-input log2 "
      "(default: as the file says, or 0,1)",
      [&view](const std::string& text) { return take_domain(text, view); });
}

absl::Status finish_view_options(PictureOptions& options, const std::string& output, bool encoded) {
  ViewChoice& view = options.view;
  view.source = "--ocio";
  const char* variable = std::getenv(kVariable);
  const bool curve = options.settings.curve() != v1::TONE_CURVE_UNSPECIFIED;
  RETURN_IF_ERROR(take_lut(options));
  if (view.config.empty() && !curve && variable != nullptr && *variable != '\0') {
    view.config = variable;
    view.source = "$OCIO";
  }
  if (view.config.empty()) {
    for (const auto& [name, value] :
         {std::pair("--display", view.display), std::pair("--ocio-view", view.view),
          std::pair("--ocio-input", view.input)}) {
      if (!value.empty()) {
        return usage_error(
            absl::StrFormat("%s is part of an OpenColorIO configuration; name one with --ocio CONFIG", name));
      }
    }
    return absl::OkStatus();
  }
  if (curve) {
    return usage_error(absl::StrFormat("%s replaces --curve; give only one of them",
                                       view.lut_input.empty() ? "--ocio" : "--lut"));
  }
  const v1::Primaries primaries = options.settings.input_primaries();
  if (!view.input.empty() &&
      (options.settings.has_input_chromaticities() ||
       (primaries != v1::PRIMARIES_UNSPECIFIED && primaries != v1::PRIMARIES_REC709))) {
    return usage_error(absl::StrFormat(
        "--primaries and --ocio-input %s both say what the file's values are; give only one of them",
        view.input));
  }
  if (!view.input.empty()) options.settings.clear_input_primaries();
  if (!encoded) {
    options.notes.push_back(absl::StrFormat("%s holds the view's display values, not linear light", output));
  }
  options.settings.set_curve(v1::TONE_CURVE_TABLE);
  options.write.transfer = EncodedTransfer::kUnknown;
  return absl::OkStatus();
}

void choose_view_defaults(PictureOptions& options, bool exposure_given) {
  if (options.view.config.empty()) return;
  v1::Exposure& exposure = *options.settings.mutable_exposure();
  if (!exposure_given && exposure.mode() == v1::Exposure::MODE_UNSPECIFIED) {
    exposure.set_mode(v1::Exposure::MODE_MANUAL);
    exposure.set_manual_ev(0);
    options.defaults.exposure = true;
  }
  if (options.settings.bloom().ByteSizeLong() > 0) return;
  options.settings.mutable_bloom()->set_intensity(0);
  options.defaults.bloom = true;
}

}  // namespace candela
