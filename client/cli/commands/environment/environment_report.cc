#include "client/cli/commands/environment/environment_report.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/number_words.h"
#include "client/cli/files/failure_line.h"
#include "client/cli/files/terminal.h"
#include "client/cli/results/render_report.h"
#include "proto/candela/v1/rgb9e5.h"
#include "proto/candela/v1/settings.h"

namespace candela {
namespace {

using Json = nlohmann::ordered_json;

const char* word_of(EnvironmentLayout layout) {
  return layout == EnvironmentLayout::kFaces   ? "faces"
         : layout == EnvironmentLayout::kCross ? "cross"
                                               : "equirectangular";
}

Json levels_of(const v1::BakeHeader& bake) {
  Json levels = Json::array();
  for (const v1::BakedLevel& level : bake.levels()) {
    Json row{{"size", level.size()}, {"roughness", level.roughness()}};
    if (level.has_error()) row["error"] = level.error();
    levels.push_back(std::move(row));
  }
  return levels;
}

Json losses_of(const v1::BakeHeader& bake) {
  return {{"negative", bake.negative_components()}, {"clamped", bake.clamped_components()}};
}

// "; errors 0.01% 0.42% ..." of the levels, if they were measured.
std::string errors_of(const v1::BakeHeader& bake) {
  std::string errors;
  for (const v1::BakedLevel& level : bake.levels()) {
    if (level.has_error()) absl::StrAppend(&errors, " ", in_digits(100 * level.error(), 2), "%");
  }
  return errors.empty() ? "" : "; errors" + errors;
}

}  // namespace

std::string losses_note(const v1::BakeHeader& bake, CubeFormat format) {
  if (bake.negative_components() + bake.clamped_components() == 0) return "";
  if (format == CubeFormat::kRgba16f) {
    return absl::StrFormat(
        "rgba16f holds up to 65504: %d component%s beyond that became that; --format rgba32f keeps them",
        bake.clamped_components(), bake.clamped_components() == 1 ? "" : "s");
  }
  return absl::StrFormat(
      "rgb9e5 holds 0 .. %.0f: %d negative components became 0, and %d larger ones became that largest value",
      v1::kMaxRgb9e5, bake.negative_components(), bake.clamped_components());
}

std::string to_text(const EnvironmentReport& report, const EnvironmentOptions& options) {
  const int levels = report.bake.levels_size();
  const bool faces = options.layout == EnvironmentLayout::kFaces;
  return absl::StrFormat("%s -> %s: %dx%d, %d level%s, %s, %s%s%s; %s; %.2f s\n", escaped(options.panorama),
                         escaped(options.output), report.bake.size(), report.bake.size(), levels,
                         levels == 1 ? "" : "s", word_of(options.layout), name(options.format),
                         faces ? absl::StrFormat(", %s-handed", name(options.handedness)) : "",
                         errors_of(report.bake), words_of(report.primaries), report.total_ms / 1000);
}

std::string to_json(const EnvironmentReport& report, const EnvironmentOptions& options) {
  const v1::Environment& panorama = report.panorama;
  Json handedness, stages = Json::object();
  if (options.layout == EnvironmentLayout::kFaces) handedness = name(options.handedness);
  for (const auto& [stage, ms] : report.stage_ms) stages[stage] = ms;
  const Json json = {{"input", options.panorama},
                     {"output", options.output},
                     {"id", panorama.id()},
                     {"panorama", {{"width", panorama.width()}, {"height", panorama.height()}}},
                     {"primaries", to_json(report.primaries)},
                     {"layout", word_of(options.layout)},
                     {"format", name(options.format)},
                     {"handedness", handedness},
                     {"rotation_deg", options.rotation_deg},
                     {"roughness_mapping", v1::word_of(options.roughness_mapping)},
                     {"size", report.bake.size()},
                     {"levels", levels_of(report.bake)},
                     {"tier", report.bake.tier()},
                     {"had_it", panorama.had_it()},
                     {"bad_values", bad_values_json(panorama)},
                     {"clamped_components", panorama.clamped_components()},
                     {"missing_pixels", report.missing_pixels},
                     {"losses", losses_of(report.bake)},
                     {"files", report.files},
                     {"stage_ms", stages},
                     {"total_ms", report.total_ms},
                     {"notes", report.notes}};
  // A path may not be UTF-8, so invalid bytes are replaced.
  return line_of(json);
}

}  // namespace candela
