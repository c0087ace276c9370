// The options of the commands that are no runs, after parsing.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/run/options.h"

namespace candela {

struct BenchOptions {
  uint32_t sessions = 1;
  uint32_t width = 1920;
  uint32_t height = 1080;
  double fps = 0;  // 0: as fast as possible
  absl::Duration duration = absl::Seconds(10);
  uint32_t lookahead = 0;
  absl::Duration timeout = absl::InfiniteDuration();  // of a frame on the server
  v1::Encoding encoding = v1::ENCODING_RAW;
  ServerChoice server;
  std::string json;
  bool quiet = false;
};

// One of `output`, `sequence` and `panorama` is not empty.
struct SampleOptions {
  std::string output;    // a scene
  std::string sequence;  // a pattern with %d, or a folder
  std::string panorama;  // a panorama
  uint64_t frames = 48;  // length of a sequence
  uint32_t width = 0;    // 0, until parsing ends: not given
  uint32_t height = 0;
  bool quiet = false;
};

struct ReportOptions {
  std::string directory;
  bool quick = false;
  std::vector<double> megapixels;      // frame sizes, ascending, at least one
  std::vector<std::string> images;     // files; none: the sample scene
  std::vector<std::string> panoramas;  // files; none: the sample panorama
  ServerChoice server;
  bool quiet = false;
};

struct InfoOptions {
  InfoOptions() { server.resume_limit = absl::ZeroDuration(); }

  // To describe: files, patterns and folders; or "-", standard input. None: the server, or the configuration.
  std::vector<std::string> files;
  std::vector<std::string> only;  // see find_frames()
  std::string config;             // of OpenColorIO, to describe; empty: none
  ServerChoice server;
  std::string json;  // as in RenderOptions
};

struct HealthOptions {
  ServerChoice server;  // never the built-in one
  absl::Duration timeout = absl::Seconds(5);
};

}  // namespace candela
