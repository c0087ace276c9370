#include "client/cli/commands/bench/bench_report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/number_words.h"

namespace candela {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kWindows = 10;
constexpr size_t kStableWindows = 3;
constexpr double kStableWithin = 0.1;

// The values of all frames, ascending.
std::vector<double> sorted(const BenchReport& report, double BenchFrame::*member) {
  std::vector<double> values;
  for (const BenchSession& session : report.sessions) {
    for (const BenchFrame& frame : session.frames) values.push_back(frame.*member);
  }
  std::sort(values.begin(), values.end());
  return values;
}

// The percentile by nearest rank; 0 if there are no values.
double percentile(const std::vector<double>& values, double percent) {
  if (values.empty()) return 0;
  const double rank = std::ceil(percent / 100 * static_cast<double>(values.size()));
  return values[static_cast<size_t>(std::clamp(rank, 1.0, static_cast<double>(values.size()))) - 1];
}

uint64_t sum(const BenchReport& report, uint64_t BenchSession::*member) {
  uint64_t all = 0;
  for (const BenchSession& session : report.sessions) all += session.*member;
  return all;
}

std::vector<double> session_rates(const BenchReport& report) {
  std::vector<double> rates;
  for (const BenchSession& session : report.sessions) {
    rates.push_back(static_cast<double>(session.frames.size()) / report.seconds);
  }
  return rates;
}

// Jain's fairness index: 1 if all sessions get the same rate, 1/n if one gets everything.
double jain(const std::vector<double>& rates) {
  double all = 0, squares = 0;
  for (const double rate : rates) {
    all += rate;
    squares += rate * rate;
  }
  return squares == 0 ? 1 : all * all / (static_cast<double>(rates.size()) * squares);
}

double frames_per_second(const BenchReport& report) {
  const std::vector<double> rates = session_rates(report);
  double all = 0;
  for (const double rate : rates) all += rate;
  return all;
}

double megapixels(const BenchOptions& options) { return 1e-6 * options.width * options.height; }

const char* transport_of(const BenchReport& report) {
  return std::all_of(report.sessions.begin(), report.sessions.end(),
                     [](const BenchSession& session) { return session.shares_memory; })
             ? "memory"
             : "grpc";
}

Json percentiles(const std::vector<double>& values) {
  return {{"p50", percentile(values, 50)}, {"p90", percentile(values, 90)}, {"p99", percentile(values, 99)}};
}

}  // namespace

std::vector<double> window_rates(const BenchReport& report) {
  std::vector<double> rates(kWindows, 0);
  const double length = report.seconds / kWindows;
  for (const BenchSession& session : report.sessions) {
    for (const BenchFrame& frame : session.frames) {
      rates[std::min(static_cast<size_t>(frame.done_s / length), kWindows - 1)] += 1 / length;
    }
  }
  return rates;
}

bool is_stable(const BenchReport& report) {
  const std::vector<double> rates = window_rates(report);
  const auto [least, most] = std::minmax_element(rates.end() - kStableWindows, rates.end());
  return *least > 0 && *most - *least <= kStableWithin * *most;
}

std::string to_text(const BenchOptions& options, const BenchReport& report) {
  const double rate = frames_per_second(report);
  std::string text = absl::StrFormat("%d sessions of %dx%d halves at %s for %.1f s, on %s\n",
                                     options.sessions, options.width, options.height,
                                     options.fps > 0 ? in_digits(options.fps, 6) + " fps" : "full speed",
                                     report.seconds, report.device);
  const auto line = [&text](const char* name, const std::string& words) {
    absl::StrAppendFormat(&text, "  %-11s %s\n", name, words);
  };
  const auto times = [&report](double BenchFrame::*member) {
    const std::vector<double> values = sorted(report, member);
    return absl::StrFormat("p50 %.2f  p90 %.2f  p99 %.2f  p99.9 %.2f  max %.2f ms", percentile(values, 50),
                           percentile(values, 90), percentile(values, 99), percentile(values, 99.9),
                           values.empty() ? 0 : values.back());
  };
  line("throughput",
       absl::StrFormat("%.2f frames/s, %.1f megapixels/s, %.0f MiB/s sent, %.0f MiB/s received", rate,
                       rate * megapixels(options), rate * static_cast<double>(report.sent_bytes) / (1 << 20),
                       static_cast<double>(report.returned_bytes) / report.seconds / (1 << 20)));
  line("latency", times(&BenchFrame::latency_ms));
  line("queue wait", times(&BenchFrame::queue_ms));
  line("device", times(&BenchFrame::device_ms));
  line("lost", absl::StrFormat("%d frames dropped before sending, %d failed, %d resumes",
                               sum(report, &BenchSession::dropped), sum(report, &BenchSession::failed),
                               sum(report, &BenchSession::resumes)));
  const std::vector<double> rates = session_rates(report);
  const auto [least, most] = std::minmax_element(rates.begin(), rates.end());
  line("fairness",
       absl::StrFormat("%.2f .. %.2f frames/s per session, Jain index %.4f", *least, *most, jain(rates)));
  const auto format = [](std::string* out, double value) { absl::StrAppendFormat(out, "%.1f", value); };
  line("windows", absl::StrFormat("%s frames/s: %s", absl::StrJoin(window_rates(report), " ", format),
                                  is_stable(report) ? "stable, the last three differ by at most 10 %"
                                                    : "not stable, the last three differ by more than 10 %"));
  return text;
}

std::string to_json(const BenchOptions& options, const BenchReport& report) {
  const double rate = frames_per_second(report);
  const std::vector<double> latency = sorted(report, &BenchFrame::latency_ms);
  const std::vector<double> rates = session_rates(report);
  const auto [least, most] = std::minmax_element(rates.begin(), rates.end());
  Json latencies = percentiles(latency);
  latencies["p999"] = percentile(latency, 99.9);
  latencies["max"] = latency.empty() ? 0 : latency.back();
  const Json json = {{"sessions", options.sessions},
                     {"width", options.width},
                     {"height", options.height},
                     {"fps", options.fps > 0 ? Json(options.fps) : Json(nullptr)},
                     {"seconds", report.seconds},
                     {"server", options.server.address},
                     {"device", report.device},
                     {"transport", transport_of(report)},
                     {"frames", latency.size()},
                     {"dropped", sum(report, &BenchSession::dropped)},
                     {"failed", sum(report, &BenchSession::failed)},
                     {"resumes", sum(report, &BenchSession::resumes)},
                     {"frames_per_second", rate},
                     {"megapixels_per_second", rate * megapixels(options)},
                     {"latency_ms", latencies},
                     {"queue_ms", percentiles(sorted(report, &BenchFrame::queue_ms))},
                     {"device_ms", percentiles(sorted(report, &BenchFrame::device_ms))},
                     {"fairness", {{"min_fps", *least}, {"max_fps", *most}, {"jain", jain(rates)}}},
                     {"per_session_fps", rates},
                     {"window_fps", window_rates(report)},
                     {"stable", is_stable(report)}};
  return json.dump() + "\n";
}

}  // namespace candela
