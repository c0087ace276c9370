// What the user asked for.
#pragma once

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/color/view_table.h"
#include "client/image/image.h"

namespace candela {

// Where frames are rendered.
struct ServerChoice {
  std::string address;  // "HOST:PORT" or "unix:PATH"; empty: a server inside of this process
  std::string device;   // of the server inside: a part of its name, or its index; empty: the best there is
};

struct RenderOptions {
  std::string input;
  std::string output;
  v1::Settings settings;  // output_format fits the output's extension; only what the user gave is present
  v1::ExposureState previous;  // exposure 0: none
  ViewChoice view;             // its config is empty where there is none
  WriteOptions write;
  ServerChoice server;
  bool verify = false;    // hold the image against the reference
  std::string error_map;  // a .png, "" for none; only with `verify`
  std::string json;       // a path, "-" for stdout, "" for none
  bool quiet = false;
  std::vector<std::string> notes;  // options that change nothing for this output
};

struct SampleOptions {
  std::string output;
  uint32_t width = 1920;
  uint32_t height = 1080;
  bool quiet = false;
};

struct ReportOptions {
  std::string directory;
  bool quick = false;
  std::vector<double> megapixels;   // frame sizes, ascending, at least one
  std::vector<std::string> images;  // files; none: the sample scene
  ServerChoice server;
  bool quiet = false;
};

struct InfoOptions {
  ServerChoice server;
  std::string json;  // as in RenderOptions
};

struct HealthOptions {
  std::string address;
  absl::Duration timeout = absl::Seconds(5);
};

struct TextToPrint {
  std::string text;  // --help, --version
};

using Invocation =
    std::variant<TextToPrint, RenderOptions, SampleOptions, ReportOptions, InfoOptions, HealthOptions>;

// Looks at nothing but its arguments. Every failure is a usage error (see usage.h) of one line that says what
// would have been understood.
absl::StatusOr<Invocation> parse_command_line(int argc, const char* const* argv);

}  // namespace candela
