#include "client/cli/options/bench_options.h"

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/picture_options.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/sequence/session_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/words/option_kinds.h"

namespace candela {
namespace {

constexpr char kLoad[] = "Load";
constexpr v1::Range<double> kSessions{1, 256};

absl::Status set_fps(const std::string& text, double& fps) {
  fps = 0;
  if (absl::EqualsIgnoreCase(text, "max")) return absl::OkStatus();
  const absl::StatusOr<double> number = parse_number("--fps", text, kFps);
  if (!number.ok()) return usage_error(absl::StrFormat("%s, or max", number.status().message()));
  fps = *number;
  return absl::OkStatus();
}

}  // namespace

void add_bench_options(CLI::App& app, BenchOptions& options) {
  add_number(
      app, kLoad, "--sessions", "N", kSessions, options.sessions, "Concurrent sessions",
      [&options](double n) { options.sessions = static_cast<uint32_t>(n); }, true);
  add_text(
      app, kLoad, "--size", "WIDTHxHEIGHT",
      absl::StrFormat("Size of the frames, in half floats (default %dx%d)", options.width, options.height),
      [&options](const std::string& text) { return parse_size(text, options.width, options.height); });
  add_text(
      app, kLoad, "--fps", "F|max",
      absl::StrFormat("Frames a second of each session, %s; a frame that is not taken in time is dropped "
                      "(default max: as fast as the server goes)",
                      format_range(kFps)),
      [&options](const std::string& text) { return set_fps(text, options.fps); });
  add_number(app, kLoad, "--seconds", "SECONDS", {0.1, kSeconds.max}, absl::ToDoubleSeconds(options.duration),
             "How long to measure", [&options](double s) { options.duration = absl::Seconds(s); });
  add_lookahead_option(app, kLoad, options.lookahead);
  add_timeout_option(app, kLoad, options.timeout);
  add_encoding_option(app, kLoad, options.encoding, "Encoding of the images on the way back");
  add_json_option(app, kOutputSection, "Write the figures as one line of JSON", options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  add_server_options(app, options.server);
  add_transport_option(app, options.server);
}

}  // namespace candela
