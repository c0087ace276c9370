// The options that say where frames are rendered, whom to trust there and what to show.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/cli/options/options.h"

namespace candela {

// Defines --server, the options of its security, and --device. Parsing fills `choice`, which outlives the
// app.
void add_server_options(CLI::App& app, ServerChoice& choice);

// The same for a session, whose --server may name several.
void add_servers_options(CLI::App& app, ServerChoice& choice);

// The options of a connection's security alone. Each has an environment variable too: CANDELA_CLIENT_TLS_CA
// for --tls-ca, because CANDELA_TLS_CERT is candelad's.
void add_security_options(CLI::App& app, const std::string& section, ClientSecurity& security);

// After parsing: finds options that do not go together.
absl::Status check_server_options(const ServerChoice& choice);

}  // namespace candela
