// The options of every command that takes --server: whom to trust there, and what to show.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "client/security.h"

namespace candela {

// Each has a variable too, CANDELA_CLIENT_TLS_CA for --tls-ca: CANDELA_TLS_CERT is candelad's. Parsing fills
// `security`, which outlives the app.
void add_security_options(CLI::App& app, const std::string& section, ClientSecurity& security);

}  // namespace candela
