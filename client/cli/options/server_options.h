// The options for the server that renders the frames: its address, its security and its device.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/run/options.h"
#include "proto/candela/v1/limits.h"

namespace candela {

// Defines --server, the options of its security, and --device. Parsing fills `choice`, which outlives the
// app.
void add_server_options(CLI::App& app, ServerChoice& choice);

inline constexpr char kServerSection[] = "Server";  // the heading of these options in --help
inline constexpr v1::Range<double> kSeconds{0.001, 86400};

// The same for a command whose --server may name several servers, and --resume.
void add_servers_options(CLI::App& app, ServerChoice& choice);

// Defines --transport, for a command that opens sessions.
void add_transport_option(CLI::App& app, ServerChoice& choice);

// Only the options of a connection's security. Each also has an environment variable, such as
// CANDELA_CLIENT_TLS_CA for --tls-ca; "CLIENT" sets them apart from candelad's variables.
void add_security_options(CLI::App& app, const std::string& section, ClientSecurity& security);

// Defines --server for a command that asks a running server and has no built-in one.
void add_running_server_option(CLI::App& app, const std::string& section, ServerChoice& choice);

// After parsing: takes CANDELA_SERVER if neither --server nor --device is given, and refuses options that
// conflict. Of several addresses in the variable, a command that uses one takes the first.
absl::Status finish_server_options(ServerChoice& choice);

// Adds to an error that names the server's address where that address is from, unless it is from --server.
absl::Status name_source(const absl::Status& status, const ServerChoice& choice);

}  // namespace candela
