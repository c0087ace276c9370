#include "client/cli/options/session_options.h"

#include <CLI/App.hpp>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/settings_options.h"
#include "client/run/sequence.h"
#include "proto/candela/v1/settings.h"

namespace candela {
namespace {

// The options that choose the frames of a sequence: --range, --missing, --cut-at and --fps.

constexpr char kSequenceSection[] = "Sequence";

// Stores what was parsed, or returns why it could not be.
template <typename Parsed, typename Stored>
absl::Status store(absl::StatusOr<Parsed> parsed, Stored& stored) {
  if (!parsed.ok()) return parsed.status();
  stored = *std::move(parsed);
  return absl::OkStatus();
}

absl::Status parse_missing(const std::string& word, MissingFrames& missing) {
  const std::pair<const char*, MissingFrames> words[] = {
      {"error", MissingFrames::kError}, {"skip", MissingFrames::kSkip}, {"hold", MissingFrames::kHold}};
  std::vector<std::string> known;
  for (const auto& [name, value] : words) {
    if (absl::EqualsIgnoreCase(word, name)) {
      missing = value;
      return absl::OkStatus();
    }
    known.emplace_back(name);
  }
  return unknown_word("choice for --missing", word, known);
}

// Defines the options; parsing fills `choice`, which outlives the app.
void add_sequence_options(CLI::App& app, const std::string& section, SequenceChoice& choice) {
  add_text(app, section, "--range", "RANGE",
           "Frame numbers to take: 12, 100-200, -10--5, 100-200x2 (every second), 100- (to the last), or "
           "several with "
           "commas between them (default: from the first file to the last)",
           [&choice](const std::string& text) {
             return store(parse_number_ranges("--range", text), choice.range);
           });
  add_text(
      app, section, "--missing", "NAME",
      "Frame numbers without a file: error, skip (no image), hold (the image of the frame before; beside "
      "--skip-bad also for bad frames) (default error)",
      [&choice](const std::string& text) { return parse_missing(text, choice.missing); });
  add_text(app, section, "--cut-at", "N,N,...", "Numbers of frames that begin a scene, where exposure jumps",
           [&choice](const std::string& text) {
             return store(parse_frame_numbers("--cut-at", text), choice.cuts);
           });
  add_text(
      app, section, "--fps", "FPS",
      absl::StrFormat("Frames a second of media time, such as 25, 24000/1001 or 23.976, which is the same; "
                      "%s (default: the "
                      "framesPerSecond of the first OpenEXR file, else 24)",
                      format_range(kFps)),
      [&choice](const std::string& text) { return store(parse_frame_rate("--fps", text), choice.rate); });
}

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
  add_only_option(app, options.sequence.only);
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
