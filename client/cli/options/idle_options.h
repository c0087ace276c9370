// Options that change nothing beside the others of a command line, or whose values look like others than are
// meant. They are no error, but the user is told.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "candela/v1/render.pb.h"
#include "client/cli/options/options.h"
#include "client/image/encodings.h"

namespace candela {

// What a command line asks for, as far as it decides which options matter.
struct Request {
  std::map<std::string, std::string> given =
      {};                                    // the options on the command line, "--key", and their values
  v1::Settings settings = {};                // what the user gave
  const OutputEncoding* encoding = nullptr;  // of the image; null for `candela meter`
  bool view = false;                         // --ocio
  bool adapts = false;                       // there is an exposure to adapt from
  double elapsed_seconds = 0;                // since then; infinite for a session
  std::vector<std::string> servers = {};     // addresses; none: the built-in server
};

// A note for each given option that changes nothing, or looks like a slip.
std::vector<std::string> idle_options(Request request);

}  // namespace candela
