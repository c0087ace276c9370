#include "client/cli/render_report.h"

#include <cmath>
#include <cstdio>
#include <functional>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/number_words.h"
#include "client/cli/terminal.h"
#include "client/run/picture_error.h"
#include "client/run/picture_frame.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr char kLine[] = "  %-10s %s\n";

std::string metered_exposure_words(const RenderReport& report) {
  const v1::ResultHeader& header = report.header;
  const std::string factor = exposure_words(header.exposure());
  const std::string prescale =
      header.prescale() == 1 ? "" : absl::StrCat(", times prescale ", in_digits(header.prescale(), 4));
  if (report.defaults.exposure) return factor + default_exposure_words(report.defaults) + prescale;
  if (!report.metered) return factor + ", as set" + prescale;
  return absl::StrFormat("%s, metered from mean luminance 2^%s%s", factor,
                         in_decimals(header.statistics().mean_log2_luminance(), 3), prescale);
}

std::string bad_value_words(const v1::FrameStatistics& statistics) {
  std::vector<std::string> words;
  const auto add = [&words](uint64_t count, const char* what) {
    if (count > 0) words.push_back(absl::StrFormat("%d %s", count, what));
  };
  add(statistics.nan_components(), "NaN");
  add(statistics.infinite_components(), "infinite");
  add(statistics.negative_components(), "negative");
  add(statistics.clamped_components(), "too large");
  return absl::StrJoin(words, ", ");
}

v1::ImageSize image_size(const v1::ResultHeader& header) { return {header.width(), header.height()}; }

std::string time_words(const RenderReport& report) {
  const auto stage = [](std::string* out, const std::pair<std::string, double>& s) {
    absl::StrAppend(out, s.first, " ", in_digits(s.second, 3));
  };
  return absl::StrFormat("%.0f ms: %s", report.total_ms, absl::StrJoin(report.stage_ms, ", ", stage));
}

// Names the truth that the server compares the image with.
std::string truth_words(v1::ToneCurve curve) {
  if (curve == v1::TONE_CURVE_ACES_1) return "OpenColorIO's aces-1 of the light, cut to ACES AP1";
  if (curve == v1::TONE_CURVE_TABLE) return "the view's table, looked up in float64";
  return "the float64 reference";
}

constexpr char kViewTruth[] = "OpenColorIO's view of the uncut light";

std::string view_error_words(const ViewError& e) {
  if (e.pixels == 0) return absl::StrCat("no pixel is opaque, so none is compared with ", kViewTruth);
  return absl::StrFormat(
      "error against %s, the image's rounding included: at most %s codes (at %d,%d), p99.9 %s, mean %s",
      kViewTruth, in_digits(e.max_codes, 3), e.worst_x, e.worst_y, in_digits(e.p999_codes, 3),
      in_digits(e.mean_codes, 3));
}

// "at most 0.53 codes of 255: rendering 0.03 (proven), rounding 0.5"
std::string parts_words(const ErrorParts& e) {
  std::string words = absl::StrFormat(
      "%s %s codes of 255: rendering %s (%s)", e.lacks_file ? "before the file's own loss" : "at most",
      in_digits(e.sum(), 3), in_digits(e.rendering, 3), e.proven ? "proven" : "measured");
  const auto add = [&words](const char* what, double codes) {
    if (codes > 0) absl::StrAppend(&words, ", ", what, " ", in_digits(codes, 3));
  };
  add("the view's table", e.table.value_or(0));
  add("dither", e.dither);
  add("rounding", e.rounding);
  add("the file", e.file.value_or(0));
  return words;
}

nlohmann::ordered_json to_json(const ErrorParts& e) {
  return {{"sum", e.lacks_file ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(e.sum())},
          {"rendering", e.rendering},
          {"rendering_is", e.proven ? "proven" : "measured"},
          {"table", e.table ? nlohmann::ordered_json(*e.table) : nullptr},
          {"dither", e.dither},
          {"rounding", e.rounding},
          {"file", e.file ? nlohmann::ordered_json(*e.file) : nullptr}};
}

void add_verification(const RenderReport& report, const std::function<void(const char*, std::string)>& line) {
  const v1::ResultHeader& header = report.header;
  if (report.errors) line("error", parts_words(*report.errors));
  if (!header.has_verify()) return;
  const v1::Verification& v = header.verify();
  const auto errors = [](const v1::Verification& e) {
    return absl::StrFormat("at most %s codes (at %d,%d), p99.9 %s, mean %s",
                           in_digits(e.max_error_codes(), 3), e.worst_x(), e.worst_y(),
                           in_digits(e.p999_error_codes(), 3), in_digits(e.mean_error_codes(), 3));
  };
  if (report.view_error) line("verify", view_error_words(*report.view_error));
  line(report.view_error ? "" : "verify",
       absl::StrFormat("error against %s: %s", truth_words(report.tone_curve), errors(v)));
  if (report.file_error) {
    line("", absl::StrFormat("the file's own loss: at most %s codes, p99.9 %s, mean %s",
                             in_digits(report.file_error->max_codes, 3),
                             in_digits(report.file_error->p999_codes, 3),
                             in_digits(report.file_error->mean_codes, 3)));
  }
  if (report.gain_map_error) {
    line("", absl::StrFormat("the gain map's own loss: at most %s stops, p99 %s",
                             in_digits(report.gain_map_error->max_stops, 3),
                             in_digits(report.gain_map_error->p99_stops, 3)));
  }
  if (header.format() != v1::OUTPUT_FORMAT_RGBA16F) {
    line("", absl::StrFormat("%s %% of the components differ once quantised",
                             in_digits(100 * v.differing_components(), 3)));
  }
  line("", absl::StrFormat("error of the metering %s EV, of the bloom %s of its largest value",
                           in_digits(v.meter_error_ev(), 2), in_digits(v.bloom_error(), 2)));
  line("", "without rounding the scene to half: " + errors(header.verify_unrounded()));
  if (!report.error_map.empty()) {
    line("error map", absl::StrFormat("%s: %s", escaped(report.error_map), error_scale_words()));
  }
}

nlohmann::ordered_json to_json(const v1::Verification& v, v1::ToneCurve curve) {
  return {{"against", truth_words(curve)},
          {"max_error_codes", v.max_error_codes()},
          {"p999_error_codes", v.p999_error_codes()},
          {"mean_error_codes", v.mean_error_codes()},
          {"worst_pixel", {v.worst_x(), v.worst_y()}},
          {"differing_components", v.differing_components()},
          {"meter_error_ev", v.meter_error_ev()},
          {"bloom_error", v.bloom_error()}};
}

nlohmann::ordered_json to_json(const ViewError& e) {
  return {{"against", kViewTruth},
          {"max_error_codes", e.max_codes},
          {"p999_error_codes", e.p999_codes},
          {"mean_error_codes", e.mean_codes},
          {"worst_pixel", {e.worst_x, e.worst_y}},
          {"opaque_pixels", e.pixels}};
}

nlohmann::ordered_json to_json(const std::optional<ViewReport>& view) {
  if (!view) return nullptr;
  return {{"display", view->display},       {"view", view->view},
          {"input", view->input},           {"table_size", view->table_size},
          {"table_end", view->table_end},   {"max_codes", view->max_codes},
          {"p999_codes", view->p999_codes}, {"mean_codes", view->mean_codes},
          {"config", view->config},         {"from", view->source}};
}

std::string summary_line(const RenderReport& report) {
  const v1::ResultHeader& header = report.header;
  const std::string missing =
      report.missing_pixels > 0 ? absl::StrFormat("%d pixels missing; ", report.missing_pixels) : "";
  return absl::StrFormat(
      "%s -> %s: %s; %s%s; exposure %s%s; %s; %.2f s\n", escaped(report.input), escaped(report.output),
      size_words(image_size(header), report.frame), missing, words_of(report.primaries),
      exposure_words(header.exposure(), report.defaults), default_bloom_words(report.defaults),
      escaped(report.view ? view_words(*report.view) : report.curve), report.total_ms / 1000);
}

void add_everything(const RenderReport& report, std::string& text,
                    const std::function<void(const char*, std::string)>& line) {
  const v1::ResultHeader& header = report.header;
  const v1::FrameStatistics& statistics = header.statistics();
  text = absl::StrFormat("%s -> %s\n", escaped(report.input), escaped(report.output));
  line("device", absl::StrFormat("%s, tier %s", header.device(), header.tier()));
  if (!header.tier_reason().empty()) line("", header.tier_reason());
  line("size", size_words(image_size(header), report.frame));
  if (report.missing_pixels > 0) line("missing", absl::StrFormat("%d pixels", report.missing_pixels));
  line("primaries", words_of(report.primaries));
  line("exposure", metered_exposure_words(report));
  line("luminance", absl::StrFormat("%s .. %s", in_digits(statistics.min_luminance(), 4),
                                    in_digits(statistics.max_luminance(), 4)));
  if (header.has_max_light_nits()) {
    line("light",
         absl::StrFormat("at most %s nit (MaxCLL), mean %s nit (MaxFALL)",
                         in_digits(header.max_light_nits(), 4), in_digits(header.mean_light_nits(), 4)));
  }
  const std::string bad = bad_value_words(statistics);
  if (!bad.empty()) line("bad values", bad + " components");
  if (report.view) {
    const ViewReport& view = *report.view;
    const std::string table =
        view.table_size == 0
            ? "the file's own values"
            : absl::StrFormat("from %s; table of %d^3 points, error at most %s codes, mean %s", view.input,
                              view.table_size, in_digits(view.max_codes, 2), in_digits(view.mean_codes, 2));
    line("view",
         absl::StrFormat("%s, %s, of %s (%s); %s", view.display, view.view, view.config, view.source, table));
  }
  for (int i = 0; i < header.plan_size(); ++i) line(i == 0 ? "plan" : "", header.plan(i));
  add_verification(report, line);
  line("time", time_words(report));
}

}  // namespace

std::string default_exposure_words(const PictureDefaults& defaults) {
  if (!defaults.exposure) return "";
  return absl::StrCat(", the default of ", defaults.light == PictureLight::kScene ? "a view"
                                           : defaults.light == PictureLight::kSdr ? "an SDR picture"
                                                                                  : "an HDR picture");
}

std::string default_bloom_words(const PictureDefaults& defaults) {
  return defaults.bloom ? ", no bloom" : "";
}

std::string exposure_words(double exposure, const PictureDefaults& defaults) {
  return absl::StrFormat("%s (%s EV%s)", in_digits(exposure, 4), with_sign(std::log2(exposure), 2),
                         default_exposure_words(defaults));
}

void add_light(const v1::ResultHeader& header, nlohmann::ordered_json& json) {
  if (header.has_gain_map_max_log2()) json["gain_map_max_log2"] = header.gain_map_max_log2();
  if (!header.has_max_light_nits()) return;
  json.update({{"max_light_nits", header.max_light_nits()}, {"mean_light_nits", header.mean_light_nits()}});
}

std::string to_text(const RenderReport& report, bool verbose) {
  std::string text;
  const auto line = [&text](const char* name, const std::string& words) {
    absl::StrAppendFormat(&text, kLine, name, words);
  };
  if (verbose) {
    add_everything(report, text, line);
  } else {
    text = summary_line(report);
    add_verification(report, line);
  }
  return text;
}

std::vector<std::string> notes_for_user(const RenderReport& report) {
  std::vector<std::string> notes = report.notes;
  const v1::FrameStatistics& statistics = report.header.statistics();
  const std::string bad = bad_values_note(statistics);
  if (!bad.empty()) notes.push_back(bad);
  return notes;
}

absl::Status tell(const RenderReport& report, bool quiet, bool verbose, JsonOutput& json) {
  if (!quiet) {
    for (const std::string& note : notes_for_user(report)) print_note(note);
    if (report.output == "-") {
      std::fputs(to_text(report, verbose).c_str(), stderr);
    } else if (!json.to_stdout()) {
      RETURN_IF_ERROR(print(to_text(report, verbose)));
    }
  }
  return json.write(to_json(report));
}

std::string to_json(const RenderReport& report) {
  const v1::ResultHeader& header = report.header;
  nlohmann::ordered_json stages = nlohmann::ordered_json::object();
  for (const auto& [name, ms] : report.stage_ms) stages[name] = ms;
  nlohmann::ordered_json frame = {
      {"input", report.input},
      {"output", report.output},
      {"size", {{"width", header.width()}, {"height", header.height()}}},
      {"primaries", to_json(report.primaries)},
      {"curve", report.curve},
      {"device", header.device()},
      {"tier", header.tier()},
      {"tier_reason", header.tier_reason()},
      {"exposure", header.exposure()},
  };
  if (image_size(header) != report.frame) {
    frame["frame_size"] = {{"width", report.frame.width}, {"height", report.frame.height}};
  }
  add_metering(header, frame);
  frame.update({{"missing_pixels", report.missing_pixels},
                {"view", to_json(report.view)},
                {"gamut_cut_components", header.gamut_cut_components()},
                {"plan", std::vector<std::string>(header.plan().begin(), header.plan().end())},
                {"stage_ms", stages},
                {"total_ms", report.total_ms},
                {"notes", report.notes}});
  add_light(header, frame);
  if (!report.environment.empty()) frame["environment"] = report.environment;
  if (header.has_verify()) {
    frame["verify"] = to_json(header.verify(), report.tone_curve);
    frame["verify_unrounded"] = to_json(header.verify_unrounded(), report.tone_curve);
  }
  if (report.view_error) frame["verify_view"] = to_json(*report.view_error);
  if (report.errors) frame["error_parts"] = to_json(*report.errors);
  if (report.file_error) {
    frame["verify_file"] = {{"max_error_codes", report.file_error->max_codes},
                            {"p999_error_codes", report.file_error->p999_codes},
                            {"mean_error_codes", report.file_error->mean_codes}};
  }
  if (report.gain_map != nullptr) {
    const GainMapMetadata& map = report.gain_map->metadata;
    frame["gain_map"] = {
        {"min_log2", map.min_log2}, {"max_log2", map.max_log2}, {"headroom_log2", map.headroom_hdr_log2}};
  }
  if (report.gain_map_error) {
    frame["verify_gain_map"] = {{"max_stops", report.gain_map_error->max_stops},
                                {"p99_stops", report.gain_map_error->p99_stops}};
  }
  if (!report.error_map.empty()) {
    frame["error_map"] = {{"file", report.error_map},
                          {"least_codes", kLeastErrorCodes},
                          {"most_codes", kMostErrorCodes},
                          {"scale", error_scale_words()}};
  }
  // A path may not be UTF-8, so invalid bytes are replaced.
  return line_of(frame);
}

}  // namespace candela
