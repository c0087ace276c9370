// Options that change nothing beside the others of a command line, or whose values look like others than are
// meant. They are no error, but the user is told.
#pragma once

#include <algorithm>
#include <iterator>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "candela/v1/render.pb.h"
#include "client/image/write/encodings.h"
#include "client/run/options.h"

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

// Adds these notes to the options' own. Takes settings and servers from `options`.
template <typename Options>
void add_idle_notes(Options& options, Request request) {
  request.settings = options.settings;
  if (!options.server.address.empty()) request.servers = {options.server.address};
  request.servers.insert(request.servers.end(), options.server.others.begin(), options.server.others.end());
  std::vector<std::string> notes = idle_options(std::move(request));
  std::move(notes.begin(), notes.end(), std::back_inserter(options.notes));
}

// The encoding of the images that a file name, a pattern or a folder gets.
const OutputEncoding* encoding_of(const std::string& output, v1::Encoding by_server = v1::ENCODING_RAW);

}  // namespace candela
