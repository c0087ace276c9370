// What a server's metrics port says.
#pragma once

#include <map>
#include <string>

#include "server/server.h"

namespace candela::testing {

// The whole answer to GET `path`; empty where nobody listens.
std::string get(const std::string& address, const std::string& path);

// `name{label="value"}` to its value.
std::map<std::string, double> scrape(const Server& server);

}  // namespace candela::testing
