// The options for the server that renders the frames: its address, its security and its device.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/cli/options/options.h"

namespace candela {

// Defines --server, the options of its security, and --device. Parsing fills `choice`, which outlives the
// app.
void add_server_options(CLI::App& app, ServerChoice& choice);

// The same for a session. Its --server may name several servers.
void add_servers_options(CLI::App& app, ServerChoice& choice);

// Only the options of a connection's security. Each also has an environment variable, such as
// CANDELA_CLIENT_TLS_CA for --tls-ca; "CLIENT" sets them apart from candelad's variables.
void add_security_options(CLI::App& app, const std::string& section, ClientSecurity& security);

// After parsing: refuses options that conflict.
absl::Status check_server_options(const ServerChoice& choice);

}  // namespace candela
