// The options of a session that `candela stream`, `candela meter` and `candela bench` share.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/run/options.h"
#include "proto/candela/v1/limits.h"

namespace candela {

void add_lookahead_option(CLI::App& app, const std::string& section, uint32_t& frames);
void add_encoding_option(CLI::App& app, const std::string& section, v1::Encoding& encoding,
                         const std::string& help);
void add_timeout_option(CLI::App& app, const std::string& section, absl::Duration& timeout);

// The options of a sequence's session. Parsing fills `options`, which outlives the app.
void add_session_options(CLI::App& app, StreamOptions& options);
// The files that hold its curve of exposure: --save-exposures and --exposure-plot.
void add_curve_options(CLI::App& app, StreamOptions& options);
// Its servers and --session.
void add_session_server_options(CLI::App& app, StreamOptions& options);

}  // namespace candela
