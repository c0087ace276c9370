#include "client/cli/options/meter_options.h"

#include "client/cli/options/picture/picture_options.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/sequence/session_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/words/option_kinds.h"

namespace candela {

void add_meter_options(CLI::App& app, MeterOptions& options) {
  app.add_option("IN", options.sequence.inputs,
                 "An image to meter: OpenEXR, Radiance .hdr, PFM, PNG, AVIF or JPEG; or a sequence, as "
                 "`candela stream` takes it: a "
                 "folder, files, 'in/*.exr', in/%04d.exr or in/####.exr")
      ->required()
      ->option_text(" ");
  add_session_options(app, options);
  add_choice_options(app, options);
  add_max_pixels_option(app, options);
  add_settings_options(app, options.settings, changes_metering);
  add_curve_options(app, options);
  add_json_option(app, kOutputSection,
                  "Write the numbers as one line of JSON; for a sequence one line a frame, and one for all",
                  options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  add_session_server_options(app, options);
}

absl::Status finish_meter_options(MeterOptions& options) {
  options.ignore_empty_alpha = options.settings.alpha() == v1::ALPHA_UNSPECIFIED;
  absl::Status status = check_input_names(options.sequence.inputs);
  status.Update(check_settings_options(options.settings));
  status.Update(finish_server_options(options.server));
  return status;
}

}  // namespace candela
