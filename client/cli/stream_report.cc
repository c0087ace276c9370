#include "client/cli/stream_report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "client/cli/render_report.h"
#include "client/cli/terminal.h"
#include "client/image/read_formats.h"
#include "client/image/write/atomic_file.h"
#include "client/run/output_files.h"
#include "server/base/status_macros.h"

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

namespace {

constexpr double kWidth = 900, kHeight = 420;                         // of the file
constexpr double kLeft = 60, kRight = 880, kTop = 40, kBottom = 370;  // of the axes

double seconds(const ExposedFrame& frame) { return static_cast<double>(frame.media_time_ns) * 1e-9; }

struct Curve {
  const char* name;
  const char* color;
  double (*ev)(const ExposedFrame&);
};

constexpr Curve kCurves[] = {
    {"luminance", "#8a8a8a", [](const ExposedFrame& f) { return f.mean_log2_luminance; }},
    {"target", "#d9822b", [](const ExposedFrame& f) { return std::log2(f.target); }},
    {"exposure", "#1b4f8a", [](const ExposedFrame& f) { return std::log2(f.exposure); }},
};

// Values along one axis, and where they are drawn.
struct Axis {
  double low, high;  // values
  double from, to;   // their places

  double at(double value) const { return from + (value - low) / (high - low) * (to - from); }

  // Round values at equal distances, at most nine.
  std::vector<double> tics() const {
    const double decade = std::pow(10, std::floor(std::log10((high - low) / 8)));
    double step = decade;
    for (const double factor : {1, 2, 5, 10}) {
      step = factor * decade;
      if ((high - low) / step <= 8) break;
    }
    std::vector<double> all;
    for (double tic = std::ceil(low / step); tic * step <= high; ++tic) all.push_back(tic * step);
    return all;
  }
};

Axis time_axis(const std::vector<ExposedFrame>& curve) {
  const double begin = seconds(curve.front()), end = seconds(curve.back());
  return begin < end ? Axis{begin, end, kLeft, kRight} : Axis{begin - 1, begin + 1, kLeft, kRight};
}

Axis ev_axis(const std::vector<ExposedFrame>& curve) {
  constexpr double kMargin = 0.25;  // EV
  double low = kCurves[0].ev(curve.front()), high = low;
  for (const ExposedFrame& frame : curve) {
    for (const Curve& of : kCurves) {
      low = std::min(low, of.ev(frame));
      high = std::max(high, of.ev(frame));
    }
  }
  return {low - kMargin, high + kMargin, kBottom, kTop};
}

std::string drawn(const std::vector<ExposedFrame>& curve) {
  const Axis time = time_axis(curve), ev = ev_axis(curve);
  std::string svg = absl::StrFormat(
      "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %g %g\" font-family=\"sans-serif\" "
      "font-size=\"13\" fill=\"none\">\n<rect width=\"%g\" height=\"%g\" fill=\"#fff\"/>\n",
      kWidth, kHeight, kWidth, kHeight);
  const auto text = [&svg](double x, double y, const char* anchor, const char* color,
                           const std::string& words) {
    absl::StrAppendFormat(&svg, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" fill=\"%s\">%s</text>\n", x,
                          y, anchor, color, words);
  };
  const auto line = [&svg](double x0, double y0, double x1, double y1, const char* style) {
    absl::StrAppendFormat(&svg, "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style);
  };
  for (const double tic : time.tics()) {
    line(time.at(tic), kTop, time.at(tic), kBottom, "stroke=\"#ddd\"");
    text(time.at(tic), kBottom + 18, "middle", "#333", absl::StrFormat("%.6g", tic));
  }
  for (const double tic : ev.tics()) {
    line(kLeft, ev.at(tic), kRight, ev.at(tic), "stroke=\"#ddd\"");
    text(kLeft - 8, ev.at(tic) + 4, "end", "#333", absl::StrFormat("%.6g", tic));
  }
  for (const ExposedFrame& frame : curve) {
    if (!frame.cut) continue;
    line(time.at(seconds(frame)), kTop, time.at(seconds(frame)), kBottom,
         "stroke=\"#888\" stroke-dasharray=\"3\"");
  }
  text((kLeft + kRight) / 2, kHeight - 12, "middle", "#333", "media time, s");
  text(kLeft, kTop - 14, "end", "#333", "EV");
  for (const Curve& of : kCurves) {
    text(kLeft + 20 + 110 * static_cast<double>(&of - kCurves), kTop - 14, "start", of.color, of.name);
    absl::StrAppendFormat(&svg, "<polyline stroke=\"%s\" stroke-width=\"1.6\" points=\"", of.color);
    for (const ExposedFrame& frame : curve) {
      absl::StrAppendFormat(&svg, "%.2f,%.2f ", time.at(seconds(frame)), ev.at(of.ev(frame)));
    }
    svg += "\"/>\n";
    const ExposedFrame& last = curve.back();
    absl::StrAppendFormat(&svg, "<circle cx=\"%.2f\" cy=\"%.2f\" r=\"2.5\" fill=\"%s\"/>\n",
                          time.at(seconds(last)), ev.at(of.ev(last)), of.color);
  }
  return svg + "</svg>\n";
}

}  // namespace

absl::Status check_plot(const std::string& path) {
  if (extension_of(path) != ".svg") {
    return usage_error(absl::StrFormat("--exposure-plot is %s; it must end in .svg", path));
  }
  RETURN_IF_ERROR(make_folder_of(path));
  return writable_destination(path).status();
}

absl::Status plot_exposure(const std::vector<ExposedFrame>& curve, const std::string& path) {
  ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(path));
  const std::string svg = drawn(curve);
  file.write(svg.data(), svg.size());
  return file.commit();
}

}  // namespace candela
