#include "client/cli/results/stream_report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/number_words.h"
#include "client/cli/files/failure_line.h"
#include "client/cli/files/terminal.h"
#include "client/cli/results/render_report.h"

namespace candela {
namespace {

using Json = nlohmann::ordered_json;

double per_second(const RunSummary& summary) {
  const double seconds = absl::ToDoubleSeconds(summary.time);
  return seconds > 0 ? static_cast<double>(summary.written) / seconds : 0;
}

double mean_latency_ms(const RunSummary& summary) {
  return summary.written == 0
             ? 0
             : absl::ToDoubleMilliseconds(summary.latency) / static_cast<double>(summary.written);
}

}  // namespace

std::string to_json(const RunFrame& frame) {
  Json json = {{"frame", frame.facts.number},
               {"input", frame.facts.input},
               {"output", frame.output},
               {"media_time_ns", frame.facts.media_time_ns}};
  if (frame.output.empty()) json.erase("output");
  if (!frame.status.ok()) {
    json["error"] = std::string(frame.status.message());
    json["code"] = exit_code(kind_of(frame.status));
  }
  if (frame.held) json["held"] = true;
  if (!frame.status.ok() || frame.held) return line_of(json);
  const v1::ResultHeader& header = frame.header;
  json["primaries"] = to_json(frame.facts.primaries);
  json.update({{"width", header.width()},
               {"height", header.height()},
               {"exposure", header.exposure()},
               {"exposure_before", header.exposure_before()}});
  if (const v1::ImageSize& size = frame.facts.size; size != v1::ImageSize{header.width(), header.height()}) {
    json.update({{"frame_width", size.width}, {"frame_height", size.height}});
  }
  add_metering(header, json);
  json.update({{"missing_pixels", frame.facts.missing_pixels},
               {"gamut_cut_components", header.gamut_cut_components()},
               {"cut", header.cut()},
               {"tier", header.tier()},
               {"stage_ms", stages_json(header)},
               {"latency_ms", absl::ToDoubleMilliseconds(frame.latency)}});
  add_light(header, json);
  return line_of(json);
}

std::string to_json(const RunSummary& summary) {
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

std::string to_text(const RunSummary& summary, const std::string& where) {
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

}  // namespace candela
