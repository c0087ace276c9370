#include "client/cli/commands/render_report.h"

#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/files/error_map.h"
#include "proto/candela/v1/settings.h"

namespace candela {
namespace {

constexpr char kLine[] = "  %-10s %s\n";

std::string metered_exposure_words(const RenderReport& report) {
  const v1::ResultHeader& header = report.header;
  const std::string factor =
      absl::StrFormat("%.4g (%+.2f EV)", header.exposure(), std::log2(header.exposure()));
  const std::string prescale =
      header.prescale() == 1 ? "" : absl::StrFormat(", times prescale %.4g", header.prescale());
  if (report.defaults.exposure) return factor + default_exposure_words(report.defaults) + prescale;
  if (!report.metered) return factor + ", as set" + prescale;
  return absl::StrFormat("%s, metered from mean luminance 2^%.3f%s", factor,
                         header.statistics().mean_log2_luminance(), prescale);
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

std::string time_words(const RenderReport& report) {
  const auto stage = [](std::string* out, const std::pair<std::string, double>& s) {
    absl::StrAppendFormat(out, "%s %.3g", s.first, s.second);
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
      "error against %s, the image's rounding included: at most %.3g codes (at %d,%d), "
      "p99.9 %.3g, mean %.3g",
      kViewTruth, e.max_codes, e.worst_x, e.worst_y, e.p999_codes, e.mean_codes);
}

void add_verification(const RenderReport& report, const std::function<void(const char*, std::string)>& line) {
  const v1::ResultHeader& header = report.header;
  if (!header.has_verify()) return;
  const v1::Verification& v = header.verify();
  const auto errors = [](const v1::Verification& e) {
    return absl::StrFormat("at most %.3g codes (at %d,%d), p99.9 %.3g, mean %.3g", e.max_error_codes(),
                           e.worst_x(), e.worst_y(), e.p999_error_codes(), e.mean_error_codes());
  };
  if (report.view_error) line("verify", view_error_words(*report.view_error));
  line(report.view_error ? "" : "verify",
       absl::StrFormat("error against %s: %s", truth_words(report.tone_curve), errors(v)));
  if (header.format() != v1::OUTPUT_FORMAT_RGBA16F) {
    line("",
         absl::StrFormat("%.3g %% of the components differ once quantised", 100 * v.differing_components()));
  }
  line("", absl::StrFormat("error of the metering %.2g EV, of the bloom %.2g of its largest value",
                           v.meter_error_ev(), v.bloom_error()));
  line("", "without rounding the scene to half: " + errors(header.verify_unrounded()));
  if (!report.error_map.empty()) {
    line("error map", absl::StrFormat("%s: %s", report.error_map, error_scale_words()));
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
  return absl::StrFormat("%s -> %s: %dx%d; %s%s; exposure %.4g (%+.2f EV%s)%s; %s; %.2f s\n", report.input,
                         report.output, header.width(), header.height(), missing, words_of(report.primaries),
                         header.exposure(), std::log2(header.exposure()),
                         default_exposure_words(report.defaults), default_bloom_words(report.defaults),
                         report.view ? view_words(*report.view) : report.curve, report.total_ms / 1000);
}

void add_everything(const RenderReport& report, std::string& text,
                    const std::function<void(const char*, std::string)>& line) {
  const v1::ResultHeader& header = report.header;
  const v1::FrameStatistics& statistics = header.statistics();
  text = absl::StrFormat("%s -> %s\n", report.input, report.output);
  line("device", absl::StrFormat("%s, tier %s", header.device(), header.tier()));
  if (!header.tier_reason().empty()) line("", header.tier_reason());
  line("size", absl::StrFormat("%dx%d", header.width(), header.height()));
  if (report.missing_pixels > 0) line("missing", absl::StrFormat("%d pixels", report.missing_pixels));
  line("primaries", words_of(report.primaries));
  line("exposure", metered_exposure_words(report));
  line("luminance", absl::StrFormat("%.4g .. %.4g", statistics.min_luminance(), statistics.max_luminance()));
  const std::string bad = bad_value_words(statistics);
  if (!bad.empty()) line("bad values", bad + " components");
  if (report.view) {
    const ViewReport& view = *report.view;
    const std::string table =
        view.table_size == 0
            ? "the file's own values"
            : absl::StrFormat("from %s; table of %d^3 points, error at most %.2g codes, mean %.2g",
                              view.input, view.table_size, view.max_codes, view.mean_codes);
    line("view",
         absl::StrFormat("%s, %s, of %s (%s); %s", view.display, view.view, view.config, view.source, table));
  }
  for (int i = 0; i < header.plan_size(); ++i) line(i == 0 ? "plan" : "", header.plan(i));
  add_verification(report, line);
  line("time", time_words(report));
}

}  // namespace

std::string view_words(const ViewReport& view) {
  return view.source == "--ocio" ? view.view : absl::StrCat(view.view, " of ", view.source);
}

std::string curve_word(v1::Settings settings) {
  (void)v1::complete_settings(settings);  // the default, if the user chose none; parsing has checked the rest
  return v1::word_of(settings.curve());
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

std::string bad_values_note(uint64_t nan, uint64_t infinite, uint64_t clamped) {
  std::vector<std::string> words;
  if (nan + infinite > 0) {
    words.push_back(
        absl::StrFormat("%d NaN and %d infinite components were taken as 0 and +-65504", nan, infinite));
  }
  if (clamped > 0) {
    words.push_back(absl::StrFormat("%d component%s beyond 2^30, the most that is rendered, %s cut to that",
                                    clamped, clamped == 1 ? "" : "s", clamped == 1 ? "was" : "were"));
  }
  return absl::StrJoin(words, "; ");
}

std::vector<std::string> notes_for_user(const RenderReport& report) {
  std::vector<std::string> notes = report.notes;
  const v1::FrameStatistics& statistics = report.header.statistics();
  const std::string bad = bad_values_note(statistics);
  if (!bad.empty()) notes.push_back(bad);
  return notes;
}

std::string to_json(const RenderReport& report) {
  const v1::ResultHeader& header = report.header;
  const v1::FrameStatistics& statistics = header.statistics();
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
      {"target", header.target()},
      {"target_before_limits", header.target_before_limits()},
      {"mean_log2_luminance", statistics.mean_log2_luminance()},
      {"min_luminance", static_cast<double>(statistics.min_luminance())},
      {"max_luminance", static_cast<double>(statistics.max_luminance())},
      {"bad_values", bad_values_json(statistics)},
      {"clamped_components", statistics.clamped_components()},
      {"absent_pixels", statistics.absent_pixels()},
      {"missing_pixels", report.missing_pixels},
      {"view", to_json(report.view)},
      {"gamut_cut_components", header.gamut_cut_components()},
      {"plan", std::vector<std::string>(header.plan().begin(), header.plan().end())},
      {"stage_ms", stages},
      {"total_ms", report.total_ms},
      {"notes", report.notes},
  };
  if (!report.environment.empty()) frame["environment"] = report.environment;
  if (header.has_verify()) {
    frame["verify"] = to_json(header.verify(), report.tone_curve);
    frame["verify_unrounded"] = to_json(header.verify_unrounded(), report.tone_curve);
  }
  if (report.view_error) frame["verify_view"] = to_json(*report.view_error);
  if (!report.error_map.empty()) {
    frame["error_map"] = {{"file", report.error_map},
                          {"least_codes", kLeastErrorCodes},
                          {"most_codes", kMostErrorCodes},
                          {"scale", error_scale_words()}};
  }
  // A path may not be UTF-8, so invalid bytes are replaced.
  return frame.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace candela
