// The result of `candela render`, as text and as JSON.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/cli/files/primaries_used.h"
#include "client/cli/options/options.h"
#include "client/color/view_error.h"

namespace candela {

// The view of --ocio, and the error of its table against
// OpenColorIO's own code; see client/color/view_table.h.
struct ViewReport {
  std::string display;
  std::string view;
  std::string input;
  uint32_t table_size = 0;
  double table_end = 0;
  double max_codes = 0;
  double p999_codes = 0;
  double mean_codes = 0;
  std::string config;  // its path
  std::string source;  // what named it, "--ocio" or "$OCIO"
};

// "ACES", or "ACES of $OCIO" if the environment chose the view.
std::string view_words(const ViewReport& view);

struct RenderReport {
  std::string input;
  std::string output;
  std::string environment;  // the id of the panorama that it is a view of; "": it is a frame
  PrimariesUsed primaries;
  uint64_t missing_pixels = 0;  // of an unfinished or damaged file
  std::string curve;            // its word, or the name of the view of --ocio
  v1::ResultHeader header;
  std::string error_map;  // "" if none is written
  bool metered = true;    // false if the user set the exposure
  PictureDefaults defaults;
  std::optional<ViewReport> view;
  std::optional<ViewError> view_error;                    // only with --verify
  v1::ToneCurve tone_curve = v1::TONE_CURVE_UNSPECIFIED;  // as the settings have it
  // In this order: start, view, read, the server's stages, other, write; of a view of a panorama: ocio, read,
  // start, put, the server's stages, other, write. The built-in server starts while the image is read.
  // `other` is the part of the call outside the server's stages: sending, receiving, and compiling shaders
  // for a first frame.
  std::vector<std::pair<std::string, double>> stage_ms;
  double total_ms = 0;  // from the start of the command until the file is written
  std::vector<std::string> notes;
};

// The time since `begin`, for stage_ms and total_ms.
inline double ms_since(absl::Time begin) { return absl::ToDoubleMilliseconds(absl::Now() - begin); }

// "1.25 (+0.32 EV)"
std::string exposure_words(double exposure, const PictureDefaults& defaults = {});

// The word of the curve that the settings ask for.
std::string curve_word(v1::Settings settings);

// The result in one line, with a line end, and if the frame was verified the lines about that. `verbose`: all
// about it in several lines.
std::string to_text(const RenderReport& report, bool verbose);

// Says what became of values that were no numbers or beyond 2^30; "" if there were none.
std::string bad_values_note(uint64_t nan, uint64_t infinite, uint64_t clamped);
// The same of a frame or a panorama. `counted` is the message that counts them.
template <typename Message>
std::string bad_values_note(const Message& counted) {
  return bad_values_note(counted.nan_components(), counted.infinite_components(),
                         counted.clamped_components());
}

// {nan, inf, negative}: how many components of a frame or a panorama were such. `counted` is the message that
// counts them.
template <typename Message>
nlohmann::ordered_json bad_values_json(const Message& counted) {
  return {{"nan", counted.nan_components()},
          {"inf", counted.infinite_components()},
          {"negative", counted.negative_components()}};
}

// The report's notes, and one about values that were no numbers, if there were any.
std::vector<std::string> notes_for_user(const RenderReport& report);

// One object on one line, with the keys input, output, environment (only of a view), size {width, height},
// primaries {name, xy, from} (name null if they have none; from as in primaries_used.h), curve, device,
// tier, tier_reason, exposure, target, target_before_limits, mean_log2_luminance, min_luminance,
// max_luminance, bad_values {nan, inf, negative}, clamped_components, absent_pixels, missing_pixels, view
// {display, view, input, table_size, table_end, max_codes, p999_codes, mean_codes, config, from} (null
// without --ocio; from is --ocio or $OCIO), gamut_cut_components, plan, stage_ms, total_ms, notes. A verified
// frame also has verify and verify_unrounded {against, max_error_codes, p999_error_codes, mean_error_codes,
// worst_pixel [x, y], differing_components, meter_error_ev, bloom_error}, with --ocio also verify_view
// {against, max_error_codes, p999_error_codes, mean_error_codes, worst_pixel [x, y], opaque_pixels}, and with
// --error-map it has error_map {file, least_codes, most_codes, scale}. Numbers read back to the same bits. An
// infinite number becomes null.
std::string to_json(const RenderReport& report);

}  // namespace candela
