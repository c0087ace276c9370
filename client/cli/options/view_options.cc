#include "client/cli/options/view_options.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/options/usage.h"

namespace candela {
void add_view_options(CLI::App& app, ViewChoice& view) {
  const auto add = [&](const char* name, const char* placeholder, const char* help, std::string& to) {
    add_text(app, kToneSection, name, placeholder, help, to);
  };
  add("--ocio", "CONFIG", "Instead of a curve: a view of this OpenColorIO configuration", view.config);
  add("--display", "NAME", "Display of --ocio (default: the configuration's)", view.display);
  add("--view", "NAME",
      "View of --ocio (default: the display's); without --ocio, view of a multi-view OpenEXR file, such as "
      "left "
      "(with --ocio use --layer or --part for it)",
      view.view);
  add("--ocio-input", "NAME", "Colour space of --ocio that is linear Rec.709 (default: Candela looks for it)",
      view.input);
}

absl::Status finish_view_options(PictureOptions& options, const std::string& output, bool encoded) {
  const ViewChoice& view = options.view;
  if (view.config.empty()) {
    options.shown.view = view.view;
    for (const auto& [name, value] :
         {std::pair("--display", view.display), std::pair("--ocio-input", view.input)}) {
      if (!value.empty()) {
        return usage_error(
            absl::StrFormat("%s is part of an OpenColorIO configuration; name one with --ocio CONFIG", name));
      }
    }
    return absl::OkStatus();
  }
  if (options.settings.curve() != v1::TONE_CURVE_UNSPECIFIED) {
    return usage_error("--ocio replaces --curve; give only one of them");
  }
  if (!encoded) {
    options.notes.push_back(absl::StrFormat("%s holds the view's display values, not linear light", output));
  }
  options.settings.set_curve(v1::TONE_CURVE_TABLE);
  options.write.transfer = EncodedTransfer::kUnknown;
  return absl::OkStatus();
}

}  // namespace candela
