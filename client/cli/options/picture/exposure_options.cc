#include "client/cli/options/picture/exposure_options.h"

#include "absl/strings/str_format.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/words/option_kinds.h"

namespace candela {
namespace {

bool is_manual(const v1::Settings& settings) {
  return settings.exposure().mode() == v1::Exposure::MODE_MANUAL;
}

absl::Status conflict(const std::string& one, const std::string& other) {
  return usage_error(
      absl::StrFormat("%s and %s both decide the exposure; give only one of them", one, other));
}

}  // namespace

void add_previous_options(CLI::App& app, v1::ExposureState& previous) {
  add_text(
      app, kExposureSection, "--previous-exposure", "FACTOR",
      absl::StrFormat(
          "Exposure of the previous frame, to adapt from; %s (default: none, the frame takes its target)",
          format_range(v1::kExposureLimit)),
      [&previous](const std::string& text) {
        const absl::StatusOr<double> x = parse_number("--previous-exposure", text, v1::kExposureLimit);
        if (x.ok()) previous.set_exposure(*x);
        return x.status();
      });
  add_number(app, kExposureSection, "--elapsed", "SECONDS", v1::kElapsedSeconds, 0,
             "Media time since the previous frame",
             [&previous](double s) { previous.set_elapsed_seconds(s); });
}

void add_locked_exposure_option(CLI::App& app, std::string& file) {
  add_text(app, kExposureSection, "--locked-exposure", "FILE",
           "Expose every frame alike: by the locked exposure of this file, which --save-exposures wrote",
           file);
}

void add_given_exposure_options(CLI::App& app, StreamOptions& options) {
  add_text(
      app, kExposureSection, "--exposures", "FILE",
      "Give each frame the exposure of its number in this file, which --save-exposures wrote; so parts of "
      "a shot get the images of one run",
      options.exposures);
  add_locked_exposure_option(app, options.locked_exposure);
}

void add_state_option(CLI::App& app, const std::string& section, StreamOptions& options) {
  add_text(app, section, "--state", "FILE",
           "Continue the exposure after the last frame of this file, which --save-exposures wrote",
           options.state);
}

void add_save_exposures_option(CLI::App& app, StreamOptions& options) {
  add_text(app, kOutputSection, "--save-exposures", "FILE",
           "Write the frames' exposures, one locked exposure for all of them and the state after the last "
           "frame, as JSON; --exposures, --locked-exposure and --state read it",
           options.save_exposures);
}

absl::Status finish_previous_options(const v1::ExposureState& previous) {
  if (previous.exposure() != 0 || previous.elapsed_seconds() == 0) return absl::OkStatus();
  return usage_error("--elapsed needs --previous-exposure; give both");
}

absl::Status finish_locked_exposure(const std::string& file, const v1::Settings& settings,
                                    const v1::ExposureState& previous) {
  if (file.empty()) return absl::OkStatus();
  if (is_manual(settings)) return conflict("--locked-exposure", "--exposure");
  if (previous.exposure() != 0) return conflict("--locked-exposure", "--previous-exposure");
  return absl::OkStatus();
}

absl::Status finish_exposure_options(StreamOptions& options) {
  if (!options.exposures.empty() && !options.locked_exposure.empty()) {
    return conflict("--exposures", "--locked-exposure");
  }
  const bool each = !options.exposures.empty();
  if (!each && options.locked_exposure.empty()) return absl::OkStatus();
  const std::string name = each ? "--exposures" : "--locked-exposure";
  if (is_manual(options.settings)) return conflict(name, "--exposure");
  if (!options.state.empty()) return conflict(name, "--state");
  if (options.lookahead > 0) {
    options.notes.push_back(absl::StrFormat("--lookahead changes no exposure beside %s", name));
    options.lookahead = 0;
  }
  if (options.cut_threshold_ev > 0) {
    options.notes.push_back(absl::StrFormat("--detect-cuts changes no exposure beside %s", name));
  }
  return absl::OkStatus();
}

}  // namespace candela
