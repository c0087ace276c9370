// candelad's command line: flags, CANDELA_* variables and the configuration file, read into a Config.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "server/config.h"

namespace candela {

struct Invocation {
  Config config;
  bool list_devices = false;
  std::string text;  // not empty: print this and exit (--help, --version, --print-config)
};

// Reads the flags, then the variables, then the file that --config names. The first of them that sets an
// option wins. INVALID_ARGUMENT, in one line, for anything unknown, malformed or out of range.
absl::StatusOr<Invocation> parse_invocation(int argc, const char* const* argv);

}  // namespace candela
