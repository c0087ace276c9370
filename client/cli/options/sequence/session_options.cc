#include "client/cli/options/sequence/session_options.h"

#include "absl/strings/str_format.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/exposure_options.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/sequence/sequence_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/words/option_kinds.h"
#include "proto/candela/v1/settings.h"

namespace candela {
namespace {

constexpr char kSession[] = "Session";
constexpr double kGoodCutEv = 1;

// The value is optional: --detect-cuts, --detect-cuts=0.7, --detect-cuts 0.7.
void add_cuts(CLI::App& app, double& threshold_ev) {
  const auto take = [&threshold_ev](const std::string& text) {
    threshold_ev = kGoodCutEv;
    if (text.empty()) return;
    const absl::StatusOr<double> ev = parse_number("--detect-cuts", text, v1::kCutThresholdEv);
    if (!ev.ok()) {
      throw OptionError{usage_error(
          absl::StrFormat("%s; --detect-cuts without a number must come last or before another option",
                          ev.status().message()))};
    }
    threshold_ev = *ev;
  };
  app.add_option_function<std::string>(
         "--detect-cuts", take,
         absl::StrFormat("Detect cuts: a frame that differs from the previous one by "
                         "more than this begins a scene, and exposure jumps to its "
                         "target; %s (%s if no number is given; default: no detection)",
                         format_range(v1::kCutThresholdEv), v1::format_number(kGoodCutEv)))
      ->option_text("[EV]")
      ->expected(0, 1)
      ->group(kSession)
      ->take_last();
}

}  // namespace

void add_lookahead_option(CLI::App& app, const std::string& section, uint32_t& frames) {
  add_number(
      app, section, "--lookahead", "N", {0, double{v1::kLookahead.max}}, 0,
      "Frames of look-ahead for auto exposure; output is delayed by as many",
      [&frames](double n) { frames = static_cast<uint32_t>(n); }, true);
}

void add_encoding_option(CLI::App& app, const std::string& section, v1::Encoding& encoding,
                         const std::string& help) {
  add_enum<v1::Encoding>(app, section, "--encoding", "encoding", v1::ENCODING_RAW, help,
                         [&encoding](v1::Encoding chosen) { encoding = chosen; });
}

void add_timeout_option(CLI::App& app, const std::string& section, absl::Duration& timeout) {
  add_text(app, section, "--frame-timeout", "SECONDS",
           absl::StrFormat(
               "Fail a frame if the server has not begun to render it this long after it read its header; %s "
               "(default: none)",
               format_range(kSeconds)),
           [&timeout](const std::string& text) {
             const absl::StatusOr<double> seconds = parse_number("--frame-timeout", text, kSeconds);
             if (seconds.ok()) timeout = absl::Seconds(*seconds);
             return seconds.status();
           });
}

void add_session_options(CLI::App& app, StreamOptions& options) {
  add_sequence_options(app, kSequenceSection, options.sequence);
  add_lookahead_option(app, kSession, options.lookahead);
  add_cuts(app, options.cut_threshold_ev);
  add_state_option(app, kSession, options);
  add_timeout_option(app, kSession, options.timeout);
  app.add_flag("--skip-bad", options.skip_bad,
               "Skip files that cannot be read and frames that fail; the others keep their time and number")
      ->group(kSession);
}

void add_curve_options(CLI::App& app, StreamOptions& options) {
  add_save_exposures_option(app, options);
  add_text(app, kOutputSection, "--exposure-plot", "FILE", "Draw exposure over time: a .svg file",
           options.plot);
}

void add_session_server_options(CLI::App& app, StreamOptions& options) {
  add_servers_options(app, options.server);
  add_transport_option(app, options.server);
  add_text(app, kServerSection, "--session", "NAME", "Name of the session (default: a random one)",
           options.session);
}

}  // namespace candela
