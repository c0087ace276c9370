// What `candela render` says about a frame, for people and for programs.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "candela/v1/render.pb.h"

namespace candela {

// The view of --ocio, and how far its table is from OpenColorIO's own code: see client/color/view_table.h.
struct ViewReport {
  std::string display;
  std::string view;
  std::string input;
  uint32_t table_size = 0;
  double table_end = 0;
  double max_codes = 0;
  double p999_codes = 0;
  double mean_codes = 0;
};

struct RenderReport {
  std::string input;
  std::string output;
  v1::ResultHeader header;
  std::string error_map;  // "" for none
  bool metered = true;    // false: the exposure was given
  std::optional<ViewReport> view;
  // In the order of the work: start, view, read, the server's own, other, write. A server of our own starts
  // while the image is read. `other` is what of the call is not in the server's stages: the frame's way there
  // and back, and with a first frame the driver's compiling.
  std::vector<std::pair<std::string, double>> stage_ms;
  double total_ms = 0;  // from the beginning of the command to the written file
  std::vector<std::string> notes;
};

// Some lines, each ended.
std::string to_text(const RenderReport& report);

// One object on one line: input, output, size {width, height}, device, tier, tier_reason, exposure, target,
// mean_log2_luminance, min_luminance, max_luminance, bad_values {nan, inf, negative}, view {display,
// view, input, table_size, table_end, max_codes, p999_codes, mean_codes} (null without --ocio), plan,
// stage_ms, total_ms, notes; of a verified frame also verify and verify_unrounded {max_error_codes,
// p999_error_codes, mean_error_codes, worst_pixel [x, y], differing_components, meter_error_ev, bloom_error},
// and of its error map error_map {file, least_codes, most_codes, scale}. Numbers read back to the same bits;
// an infinite one is null.
std::string to_json(const RenderReport& report);

}  // namespace candela
