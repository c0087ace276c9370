#include "client/cli/options/session_options.h"

#include "absl/strings/str_format.h"
#include "client/cli/options/option_kinds.h"

namespace candela {

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
           absl::StrFormat("Drop a frame that waits longer on the server; %s (default: none)",
                           format_range(kSeconds)),
           [&timeout](const std::string& text) {
             const absl::StatusOr<double> seconds = parse_number("--frame-timeout", text, kSeconds);
             if (seconds.ok()) timeout = absl::Seconds(*seconds);
             return seconds.status();
           });
}

}  // namespace candela
