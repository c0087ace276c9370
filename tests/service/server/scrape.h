// Reads a server's metrics port.
#pragma once

#include <map>
#include <string>

#include "server/server.h"

namespace candela::testing {

// Returns the whole answer to GET `path`; empty if nobody listens.
std::string get(const std::string& address, const std::string& path);

// Maps `name{label="value"}` to its value.
std::map<std::string, double> scrape(const Server& server);

}  // namespace candela::testing
