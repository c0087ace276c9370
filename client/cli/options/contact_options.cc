#include "client/cli/options/contact_options.h"

#include "absl/strings/str_format.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/exposure_options.h"
#include "client/cli/options/picture/picture_options.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/picture/view_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/words/option_kinds.h"
#include "client/image/encodings.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr uint32_t kSheetCell = 320;  // pixels, the longer side of a picture
constexpr v1::Range<double> kSheetColumns{1, 1000};

}  // namespace

void add_contact_options(CLI::App& app, ContactArguments& arguments) {
  ContactOptions& options = arguments.options;
  app.add_option("IN... OUT", arguments.files,
                 absl::StrFormat("IN: images, folders or quoted patterns such as 'in/*.exr'. OUT: the sheet: "
                                 "%s. The longer side of its pictures is %d pixels",
                                 extensions_with(&OutputEncoding::takes_8_bits), kSheetCell))
      ->required()
      ->option_text(" ");
  add_choice_options(app, options);
  add_max_pixels_option(app, options);
  add_settings_options(app, options.settings);
  add_view_options(app, options);
  add_locked_exposure_option(app, options.locked_exposure);
  add_text(app, kOutputSection, "--columns", "N",
           absl::StrFormat("Pictures in a row; %s (default: as many as there are rows)",
                           format_range(kSheetColumns)),
           [&options](const std::string& text) {
             const absl::StatusOr<double> columns = parse_number("--columns", text, kSheetColumns, true);
             if (columns.ok()) options.columns = static_cast<uint32_t>(*columns);
             return columns.status();
           });
  add_json_option(app, kOutputSection, "Write one line of JSON an image, and one for all", options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  app.add_flag("--verbose,-v", options.verbose, "Print everything about each image, not only a line")
      ->group(kOutputSection);
  add_servers_options(app, options.server);
}

absl::Status finish_contact_options(ContactArguments& arguments) {
  ContactOptions& options = arguments.options;
  if (arguments.files.size() < 2) {
    return usage_error("contact needs images and a sheet: candela contact 'in/*.exr' sheet.png");
  }
  options.inputs.assign(arguments.files.begin(), arguments.files.end() - 1);
  options.output = arguments.files.back();
  RETURN_IF_ERROR(check_input_names(options.inputs));
  RETURN_IF_ERROR(check_output_name(options.output));
  v1::Settings& settings = options.settings;
  if (settings.alpha() == v1::ALPHA_UNSPECIFIED) settings.set_alpha(v1::ALPHA_OVER);
  if (!settings.has_output_size()) settings.mutable_output_size()->set_max_side(kSheetCell);
  RETURN_IF_ERROR(finish_picture_options(options, {}, options.output));
  if (settings.has_gain_map_peak_nits())
    return usage_error("--gain-map is for one picture; a sheet has none");
  if (settings.output_format() != v1::OUTPUT_FORMAT_RGBA8) {
    const bool light = settings.output_format() == v1::OUTPUT_FORMAT_RGBA16F;
    return usage_error(absl::StrFormat("%s holds %s; a sheet is a %s", options.output,
                                       light ? "light" : "more than 8 bits",
                                       extensions_with(&OutputEncoding::takes_8_bits)));
  }
  RETURN_IF_ERROR(finish_locked_exposure(options.locked_exposure, settings, options.previous));
  choose_view_defaults(options, !options.locked_exposure.empty());
  return finish_server_options(options.server);
}

}  // namespace candela
