#include "client/cli/commands/report/bounds.h"

#include <half.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "absl/strings/str_format.h"
#include "client/cli/commands/report/scenes.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// The largest error of a stage so far.
struct Worst {
  const char* key;
  const char* stage;
  const char* unit;
  double bound;
  double measured = 0;
  std::string where = "nowhere";

  void look_at(const std::string& name, const Json& row) {
    const double error = row[key].is_number() ? row[key].get<double>() : INFINITY;
    if (error < measured || (error == measured && where != "nowhere")) return;
    measured = error;
    where = name;
  }

  Json json() const {
    return {{"stage", stage}, {"unit", unit},           {"bound", bound}, {"measured", json_number(measured)},
            {"where", where}, {"ok", measured <= bound}};
  }
};

// Smaller frames do not count for the share of differing components: one component is a third of a 1x1 frame.
constexpr double kCountedComponents = 1000;

}  // namespace

absl::StatusOr<Json> measure_ingest(const ReportSession& session) {
  session.show("ingest: every half");
  ASSIGN_OR_RETURN(const Image frame, every_half());
  v1::Settings settings = ReportSession::settings(session.bounded_tier());
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.mutable_bloom()->set_intensity(0);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  ASSIGN_OR_RETURN(const RenderResult result, session.render(settings, frame));
  Worst worst = {"codes", "ingest: every half, NaN and Inf among them", "codes", 0};
  for (size_t half = 0; half < pixel_count(result); ++half) {
    const float in = imath_half_to_float(static_cast<uint16_t>(half));
    const float light = std::isnan(in) ? 0 : std::clamp(in, 0.0f, 1.0f);
    for (size_t k = 0; k < 3; ++k) {
      const double codes = 255 * std::abs(double{component(result, half, k)} - double{light});
      if (codes != 0) worst.look_at(absl::StrFormat("half 0x%04x", half), {{"codes", json_number(codes)}});
    }
  }
  if (worst.measured == 0) worst.where = "all 65536 exact";
  return worst.json();
}

Json judge_stages(const ReportSession& session, const Measured& measured) {
  Worst stages[] = {{"meter_error_ev", "metering", "EV", 8e-6},
                    {"bloom_error", "bloom, relative to its largest value", "fraction", 0x1p-9},
                    {"max_error_codes", "whole frame, largest error", "codes", 0.5},
                    {"p999_error_codes", "whole frame, 99.9 % of the pixels", "codes", 0.05},
                    {"differing_components", "components differing once quantised", "fraction", 2e-3}};
  const auto look = [&](const std::string& name, const Json& row, double pixels) {
    if (row["tier"] != session.bounded_tier() || row.contains("error")) return;
    for (Worst& stage : stages) {
      // The share is of components of 8 bits; an HDR display has 16.
      const bool is_share = stage.key == stages[4].key;
      if (!is_share || (3 * pixels >= kCountedComponents && !row.contains("display")))
        stage.look_at(name, row);
    }
  };
  const auto pixels = [](const Json& row) {
    return row["width"].get<double>() * row["height"].get<double>();
  };
  for (const Json* rows : {&measured.hard_cases, &measured.curves}) {
    for (const Json& row : *rows) look(row["case"], row, pixels(row));
  }
  for (const Json& image : measured.images) {
    for (const Json& row : image["maps"]) look(image["name"], row, pixels(image));
  }
  Json judged = Json::array();
  for (const Worst& stage : stages) judged.push_back(stage.json());
  return judged;
}

}  // namespace candela
