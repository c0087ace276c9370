#include "client/cli/commands/stream_report.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/number_words.h"
#include "client/cli/commands/render_report.h"
#include "client/cli/files/failure_line.h"
#include "client/cli/files/output_files.h"
#include "client/cli/files/plot.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/usage.h"
#include "client/image/write/atomic_file.h"

namespace candela {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kPlotWidth = 900;
constexpr int kPlotHeight = 420;
constexpr char kPlotStyle[] =
    "set border 11 lc rgb '#888888'\n"
    "set tics nomirror tc rgb '#333333'\n"
    "set grid lc rgb '#dddddd' lt 1\n"
    "set key above left Left reverse tc rgb '#333333' samplen 2\n"
    "set xlabel 'media time, s'\n"
    "set ylabel 'exposure and its target, EV'\n"
    "set y2label 'mean log2 luminance, EV'\n"
    "set y2tics\n"
    "set offsets 0, 0, graph 0.05, graph 0.05\n";

double per_second(const StreamSummary& summary) {
  const double seconds = absl::ToDoubleSeconds(summary.time);
  return seconds > 0 ? static_cast<double>(summary.written) / seconds : 0;
}

double mean_latency_ms(const StreamSummary& summary) {
  return summary.written == 0
             ? 0
             : absl::ToDoubleMilliseconds(summary.latency) / static_cast<double>(summary.written);
}

double seconds(const ExposedFrame& frame) { return static_cast<double>(frame.media_time_ns) * 1e-9; }

bool is_svg(const std::string& path) {
  return absl::AsciiStrToLower(std::filesystem::path(path).extension().string()) == ".svg";
}

}  // namespace

std::string to_json(const StreamFrame& frame) {
  Json json = {{"frame", frame.number},
               {"input", frame.input},
               {"output", frame.output},
               {"media_time_ns", frame.media_time_ns}};
  if (frame.output.empty()) json.erase("output");
  if (!frame.status.ok()) {
    json["error"] = std::string(frame.status.message());
    json["code"] = exit_code(kind_of(frame.status));
  }
  if (frame.held) json["held"] = true;
  if (!frame.status.ok() || frame.held) return line_of(json);
  const v1::ResultHeader& header = frame.header;
  const v1::FrameStatistics& statistics = header.statistics();
  json["primaries"] = to_json(frame.primaries);
  Json stages = Json::object();
  for (const v1::StageTime& stage : header.stages())
    stages[stage.name()] = static_cast<double>(stage.ns()) * 1e-6;
  json.update({{"width", header.width()},
               {"height", header.height()},
               {"exposure", header.exposure()},
               {"exposure_before", header.exposure_before()},
               {"target", header.target()},
               {"target_before_limits", header.target_before_limits()},
               {"mean_log2_luminance", statistics.mean_log2_luminance()},
               {"min_luminance", static_cast<double>(statistics.min_luminance())},
               {"max_luminance", static_cast<double>(statistics.max_luminance())},
               {"bad_values", bad_values_json(statistics)},
               {"clamped_components", statistics.clamped_components()},
               {"absent_pixels", statistics.absent_pixels()},
               {"missing_pixels", frame.missing_pixels},
               {"gamut_cut_components", header.gamut_cut_components()},
               {"cut", header.cut()},
               {"tier", header.tier()},
               {"stage_ms", stages},
               {"latency_ms", absl::ToDoubleMilliseconds(frame.latency)}});
  return line_of(json);
}

std::string to_json(const StreamSummary& summary) {
  return line_of({{"summary",
                   {{"frames", summary.frames},
                    {"first", summary.first},
                    {"last", summary.last},
                    {"missing", summary.missing},
                    {"fps", to_text(summary.rate.rate)},
                    {"fps_from", summary.rate.from},
                    {"written", summary.written},
                    {"held", summary.held},
                    {"skipped", summary.skipped},
                    {"locked_exposure", summary.locked},
                    {"seconds", absl::ToDoubleSeconds(summary.time)},
                    {"frames_per_second", per_second(summary)},
                    {"mean_latency_ms", mean_latency_ms(summary)},
                    {"resumes", summary.session.resumes},
                    {"frames_sent_again", summary.session.sent_again},
                    {"seconds_without_results", absl::ToDoubleSeconds(summary.session.time_without_results)},
                    {"server", summary.session.server}}}});
}

std::string to_text(const StreamSummary& summary, const std::string& where) {
  std::string text = absl::StrFormat("%d of %d frames %s\n", summary.written, summary.frames,
                                     where.empty() ? "metered" : "-> " + escaped(where));
  const auto line = [&text](const char* name, const std::string& words) {
    absl::StrAppendFormat(&text, "  %-10s %s\n", name, words);
  };
  line("time",
       absl::StrFormat("%.2f s, %s frames/s, mean latency %.0f ms", absl::ToDoubleSeconds(summary.time),
                       in_digits(per_second(summary), 4), mean_latency_ms(summary)));
  line("rate", to_text(summary.rate));
  if (!summary.missing.empty()) {
    line("missing", summary.missing + (summary.held > 0 ? ", held" : ""));
  }
  if (!summary.curve.empty()) {
    const auto [least, most] = std::minmax_element(
        summary.curve.begin(), summary.curve.end(),
        [](const ExposedFrame& a, const ExposedFrame& b) { return a.exposure < b.exposure; });
    const auto cuts = std::count_if(summary.curve.begin(), summary.curve.end(),
                                    [](const ExposedFrame& point) { return point.cut; });
    line("exposure",
         absl::StrFormat("%s .. %s (%s .. %s EV%s)%s%s", in_digits(least->exposure, 4),
                         in_digits(most->exposure, 4), with_sign(std::log2(least->exposure), 2),
                         with_sign(std::log2(most->exposure), 2), default_exposure_words(summary.defaults),
                         default_bloom_words(summary.defaults),
                         cuts > 0 ? absl::StrFormat(", %d cuts", cuts) : ""));
  }
  if (!summary.view.empty()) line("view", summary.view);
  if (!summary.primaries.empty()) line("primaries", absl::StrJoin(summary.primaries, "; "));
  if (where.empty() || !summary.saved.empty()) {
    line("locked", absl::StrFormat("%s (%s EV), one exposure for all frames", in_digits(summary.locked, 6),
                                   with_sign(std::log2(summary.locked), 3)));
  }
  if (!summary.saved.empty()) line("saved", escaped(summary.saved));
  if (summary.skipped > 0) line("skipped", absl::StrFormat("%d frames", summary.skipped));
  if (summary.session.resumes > 0) {
    line("resumed", absl::StrFormat("%d time%s, last on %s; %d frames resent, %.2f s without results",
                                    summary.session.resumes, summary.session.resumes == 1 ? "" : "s",
                                    summary.session.server, summary.session.sent_again,
                                    absl::ToDoubleSeconds(summary.session.time_without_results)));
  }
  return text;
}

std::string resume_words(const SessionStats& stats) {
  // After OK the server was there, and lacked the panorama of a view.
  if (stats.last_loss.ok()) return absl::StrFormat("%s had to get the panorama again", stats.server);
  // The rest of the message tells the user what to do, which the session has done.
  const std::string loss(stats.last_loss.message());
  return absl::StrFormat("%s; resumed on %s after %.2f s without losing a frame",
                         loss.substr(0, loss.find(';')), stats.server,
                         absl::ToDoubleSeconds(stats.time_without_results));
}

absl::Status check_plot(const std::string& path) {
  const std::string extension = absl::AsciiStrToLower(std::filesystem::path(path).extension().string());
  if (extension != ".png" && extension != ".svg") {
    return usage_error(absl::StrFormat("--exposure-plot is %s; it must end in .png or .svg", path));
  }
  if (absl::Status status = check_gnuplot(); !status.ok()) return status;
  if (absl::Status status = make_folder_of(path); !status.ok()) return status;
  return writable_destination(path).status();
}

absl::Status plot_exposure(const std::vector<ExposedFrame>& curve, const std::string& path) {
  std::string script = std::string(kPlotStyle) + "$curve << EOD\n";
  for (const ExposedFrame& point : curve) {
    absl::StrAppendFormat(&script, "%.9g %.9g %.9g %.9g\n", seconds(point), std::log2(point.exposure),
                          std::log2(point.target), point.mean_log2_luminance);
  }
  script += "EOD\n";
  for (const ExposedFrame& point : curve) {
    if (!point.cut) continue;
    absl::StrAppendFormat(&script,
                          "set arrow from first %.9g, graph 0 to first %.9g, graph 1 nohead dt 3 lc rgb "
                          "'#888888'\n",
                          seconds(point), seconds(point));
  }
  // gnuplot cannot derive a range from a single point.
  if (curve.size() == 1) {
    const double t = seconds(curve.front());
    absl::StrAppendFormat(&script, "set xrange [%.9g-1:%.9g+1]\n", t, t);
  }
  script +=
      "plot $curve using 1:4 axes x1y2 with steps lw 1.2 lc rgb '#8a8a8a' title 'luminance', "
      "$curve using 1:3 with steps lw 1.4 dt 2 lc rgb '#d9822b' title 'target', "
      "$curve using 1:2 with linespoints pt 7 ps 0.35 lw 1.8 lc rgb '#1b4f8a' title 'exposure'";
  const absl::StatusOr<std::string> drawn = is_svg(path)
                                                ? plot_svg("exposure", kPlotWidth, kPlotHeight, script)
                                                : plot_png(kPlotWidth, kPlotHeight, script);
  if (!drawn.ok()) return drawn.status();
  absl::StatusOr<AtomicFile> file = AtomicFile::create(path);
  if (!file.ok()) return file.status();
  const std::string head = is_svg(path) ? "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n" : "";
  file->write(head.data(), head.size());
  file->write(drawn->data(), drawn->size());
  return file->commit();
}

}  // namespace candela
