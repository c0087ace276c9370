// The result of `candela render`, as text and as JSON.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/cli/json_output.h"
#include "client/color/view_error.h"
#include "client/run/picture_frame.h"
#include "client/run/report.h"

namespace candela {

// ", the default of a view" or of a picture of a display after the exposure, or "".
std::string default_exposure_words(const PictureDefaults& defaults);
// ", no bloom" after that, or "".
std::string default_bloom_words(const PictureDefaults& defaults);

// "1.25 (+0.32 EV)"
std::string exposure_words(double exposure, const PictureDefaults& defaults = {});

// The result in one line, with a line end, and if the frame was verified the lines about that. `verbose`: all
// about it in several lines.
std::string to_text(const RenderReport& report, bool verbose);

// {nan, inf, negative}: how many components of a frame or a panorama were such. `counted` is the message that
// counts them.
template <typename Message>
nlohmann::ordered_json bad_values_json(const Message& counted) {
  return {{"nan", counted.nan_components()},
          {"inf", counted.infinite_components()},
          {"negative", counted.negative_components()}};
}

// Adds what metering says of a frame: target, target_before_limits, mean_log2_luminance, min_luminance,
// max_luminance, bad_values, clamped_components, absent_pixels. `metered` is the message that says it.
template <typename Message>
void add_metering(const Message& metered, nlohmann::ordered_json& json) {
  const v1::FrameStatistics& statistics = metered.statistics();
  json.update({{"target", metered.target()},
               {"target_before_limits", metered.target_before_limits()},
               {"mean_log2_luminance", statistics.mean_log2_luminance()},
               {"min_luminance", static_cast<double>(statistics.min_luminance())},
               {"max_luminance", static_cast<double>(statistics.max_luminance())},
               {"bad_values", bad_values_json(statistics)},
               {"clamped_components", statistics.clamped_components()},
               {"absent_pixels", statistics.absent_pixels()}});
}

// Adds how bright the image of a result is, if it is for an HDR display: max_light_nits, mean_light_nits; and
// of a gain map its gain_map_max_log2.
void add_light(const v1::ResultHeader& header, nlohmann::ordered_json& json);

// {name: milliseconds} of the stages that the message has.
template <typename Message>
nlohmann::ordered_json stages_json(const Message& message) {
  nlohmann::ordered_json stages = nlohmann::ordered_json::object();
  for (const v1::StageTime& stage : message.stages()) stages[stage.name()] = ms_of(stage);
  return stages;
}

// The report's notes, and one about values that were no numbers, if there were any.
std::vector<std::string> notes_for_user(const RenderReport& report);

// Prints the notes and, if the JSON does not go to stdout, the result; `quiet`: neither. Writes the JSON.
absl::Status tell(const RenderReport& report, bool quiet, bool verbose, JsonOutput& json);

// One object on one line, with the keys input, output, environment (only of a view), size {width, height},
// primaries {name, xy, from} (name null if they have none; from as in picture_frame.h), curve, device,
// tier, tier_reason, exposure, target, target_before_limits, mean_log2_luminance, min_luminance,
// max_luminance, bad_values {nan, inf, negative}, clamped_components, absent_pixels, missing_pixels, view
// {display, view, input, table_size, table_end, max_codes, p999_codes, mean_codes, config, from} (null
// without --ocio; from is --ocio or $OCIO), gamut_cut_components, plan, stage_ms, total_ms, notes. With
// --verify or --max-error, error_parts {sum, rendering, rendering_is, table, dither, rounding, file}, in
// 1/255 of the display range: rendering_is "measured" or "proven", table is null without a view, file is
// null if the file loses nothing, and sum and file are null of a JPEG or AVIF on standard output. A verified
// frame also has verify and verify_unrounded {against, max_error_codes, p999_error_codes, mean_error_codes,
// worst_pixel [x, y], differing_components, meter_error_ev, bloom_error}, with --ocio also verify_view
// {against, max_error_codes, p999_error_codes, mean_error_codes, worst_pixel [x, y], opaque_pixels}, and with
// --error-map error_map {file, least_codes, most_codes, scale}. A JPEG or AVIF file with error_parts also has
// verify_file {max_error_codes, p999_error_codes, mean_error_codes}, and with a gain map verify_gain_map
// {max_stops, p99_stops}. With --hdr-curve there is gain_map {min_log2 [r, g, b], max_log2 [r, g, b],
// headroom_log2}. Numbers read back to the same bits. An infinite number becomes null.
std::string to_json(const RenderReport& report);

}  // namespace candela
