// `candela bench`: its options, its sessions and its report.
#include <CLI/App.hpp>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/json_output.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/options.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/session_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/run_display.h"
#include "client/cli/terminal.h"
#include "client/image/sample.h"
#include "client/run/output_files.h"
#include "client/run/picture_frame.h"
#include "client/run/report.h"
#include "client/run/server_link.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// The times of one frame.
struct BenchFrame {
  double done_s = 0;  // when its result arrived, from the start of the run
  double latency_ms = 0;
  double queue_ms = 0;   // waiting on the server
  double device_ms = 0;  // the other stages
};

// The frames of one session.
struct BenchSession {
  std::vector<BenchFrame> frames;  // in order
  uint64_t dropped = 0;            // not sent because the session was full when they were due
  uint64_t failed = 0;             // frames that failed, mostly because they were late
  uint64_t resumes = 0;
  bool shares_memory = false;  // with the server, at the end
};

struct BenchReport {
  std::vector<BenchSession> sessions;
  double seconds = 0;
  uint64_t sent_bytes = 0;      // per frame
  uint64_t returned_bytes = 0;  // all images together
  std::string device;
};

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

// Divides the run into ten windows and returns the throughput of
// each, in frames per second over all sessions.
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

// True if the throughputs of the last three windows differ by at most 10 %.
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

// One line with the keys sessions, width, height, fps (null for max), seconds, server,
// device, transport (memory if all sessions shared it, else grpc), frames, dropped, failed, resumes,
// frames_per_second, megapixels_per_second, latency_ms {p50, p90, p99, p999, max}, queue_ms and device_ms
// {p50, p90, p99}, fairness {min_fps, max_fps, jain}, per_session_fps, window_fps, stable.
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

// The options of `candela bench`.

constexpr char kLoad[] = "Load";
constexpr v1::Range<double> kSessions{1, 256};

absl::Status set_fps(const std::string& text, double& fps) {
  fps = 0;
  if (absl::EqualsIgnoreCase(text, "max")) return absl::OkStatus();
  const absl::StatusOr<double> number = parse_number("--fps", text, kFps);
  if (!number.ok()) return usage_error(absl::StrFormat("%s, or max", number.status().message()));
  fps = *number;
  return absl::OkStatus();
}

// Defines the options; parsing fills `options`, which outlives the app.
void add_bench_options(CLI::App& app, BenchOptions& options) {
  add_number(
      app, kLoad, "--sessions", "N", kSessions, options.sessions, "Concurrent sessions",
      [&options](double n) { options.sessions = static_cast<uint32_t>(n); }, true);
  add_text(
      app, kLoad, "--size", "WIDTHxHEIGHT",
      absl::StrFormat("Size of the frames, in half floats (default %dx%d)", options.width, options.height),
      [&options](const std::string& text) { return parse_size(text, options.width, options.height); });
  add_text(
      app, kLoad, "--fps", "F|max",
      absl::StrFormat("Frames a second of each session, %s; a frame that is not taken in time is dropped "
                      "(default max: as fast as the server goes)",
                      format_range(kFps)),
      [&options](const std::string& text) { return set_fps(text, options.fps); });
  add_number(app, kLoad, "--seconds", "SECONDS", {0.1, kSeconds.max}, absl::ToDoubleSeconds(options.duration),
             "How long to measure", [&options](double s) { options.duration = absl::Seconds(s); });
  add_lookahead_option(app, kLoad, options.lookahead);
  add_timeout_option(app, kLoad, options.timeout);
  add_encoding_option(app, kLoad, options.encoding, "Encoding of the images on the way back");
  add_json_option(app, kOutputSection, "Write the figures as one line of JSON", options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  add_server_options(app, options.server);
  add_transport_option(app, options.server);
}

// The frame rate of the media time if --fps max sends frames as fast as possible.
constexpr double kNominalFps = 24;

constexpr absl::Duration kWarmUpTimeout = absl::Minutes(5);

double ms_of(const v1::ResultHeader& header, bool queue) {
  double ms = 0;
  for (const v1::StageTime& stage : header.stages()) {
    if ((stage.name() == "queue") == queue) ms += candela::ms_of(stage);
  }
  return ms;
}

// One session under load, with a thread that submits frames and a thread that takes results.
class Load {
 public:
  Load(const BenchOptions& options, Session session, std::shared_ptr<const Image> frame)
      : options_(options), session_(std::move(session)), frame_(std::move(frame)) {}
  // The threads still run if an exception ends the measurement, such as that another thread does not start.
  ~Load() {
    if (submitting_.joinable() || taking_.joinable()) session_.cancel();
    if (submitting_.joinable()) submitting_.join();
    if (taking_.joinable()) taking_.join();
  }
  Load(const Load&) = delete;
  Load& operator=(const Load&) = delete;

  void start(absl::Time begin) {
    submitting_ = std::thread([this, begin] { submit(begin); });
    taking_ = std::thread([this, begin] { take(begin); });
  }

  // Waits for the last result. Returns why the session failed, if it did.
  absl::Status finish() {
    submitting_.join();
    taking_.join();
    result_.resumes = session_.stats().resumes;
    result_.shares_memory = session_.stats().shares_memory;
    result_.dropped = dropped_;
    result_.failed = failed_;
    return status_;
  }

  BenchSession take_result() { return std::move(result_); }
  uint64_t returned_bytes() const { return returned_bytes_; }
  uint64_t answered() const { return answered_; }
  // True once no more images will come.
  bool ended() const { return ended_; }

 private:
  void submit(absl::Time begin) {
    // Nobody changes it, so all frames may be the same one.
    const FrameArea area = session_.area(frame_->width, frame_->height, v1::PIXEL_FORMAT_RGBA16F);
    const bool shared = area.pixels.size() == frame_->bytes();
    if (shared) std::memcpy(area.pixels.data(), frame_->pixels.data(), frame_->bytes());
    const absl::Time end = begin + options_.duration;
    const double fps = options_.fps > 0 ? options_.fps : kNominalFps;
    for (uint64_t i = 0;; ++i) {
      if (options_.fps > 0) {
        const absl::Time due = begin + absl::Seconds(static_cast<double>(i) / fps);
        if (due >= end) break;
        absl::SleepFor(due - absl::Now());
        if (!session_.ready()) {
          ++dropped_;
          continue;
        }
      } else if (absl::Now() >= end) {
        break;
      }
      const absl::Status status =
          session_.submit({.width = frame_->width,
                           .height = frame_->height,
                           .format = v1::PIXEL_FORMAT_RGBA16F,
                           .pixels = shared ? area.pixels : frame_->pixels.span(),
                           .owner = shared ? area.owner : frame_,
                           .sequence = i,
                           .media_time_ns = std::llround(static_cast<double>(i) * 1e9 / fps),
                           .timeout = options_.timeout});
      if (!status.ok()) break;
    }
    session_.finish();
  }

  void take(absl::Time begin) {
    while (true) {
      const absl::StatusOr<std::optional<FrameResult>> next = session_.next_result();
      status_ = of_server(next.status());
      if (!next.ok() || !*next) {
        ended_ = true;
        return;
      }
      const FrameResult& result = **next;
      ++answered_;
      if (!result.status.ok()) {
        ++failed_;
        continue;
      }
      const double done_s = absl::ToDoubleSeconds(absl::Now() - begin);
      // Results after the end are awaited but not counted.
      if (done_s > absl::ToDoubleSeconds(options_.duration)) continue;
      returned_bytes_ += result.image.bytes;
      result_.frames.push_back({done_s, absl::ToDoubleMilliseconds(result.latency),
                                ms_of(result.image.header, true), ms_of(result.image.header, false)});
    }
  }

  const BenchOptions& options_;
  Session session_;
  const std::shared_ptr<const Image> frame_;
  BenchSession result_;  // belongs to the taking thread until finish()
  absl::Status status_;
  uint64_t returned_bytes_ = 0;
  std::atomic<uint64_t> answered_ = 0;
  std::atomic<bool> ended_ = false;
  uint64_t failed_ = 0;
  uint64_t dropped_ = 0;  // belongs to the submitting thread until finish()
  std::thread submitting_;
  std::thread taking_;
};

// The first frame of a server waits until the driver has compiled the shaders.
absl::Status warm_up(ServerLink& link, const Image& frame) {
  RETURN_IF_ERROR(link.connection().status());
  const absl::Time deadline = absl::Now() + kWarmUpTimeout;
  return link.call(deadline,
                   [&](const Connection& one) { return one.render({}, view_of(frame), deadline).status(); });
}

absl::StatusOr<BenchReport> measure(const BenchOptions& options, Progress& progress) {
  progress.show("making the frame");
  ASSIGN_OR_RETURN(Image made, sample_sequence_frame(options.width, options.height, 0, 1));
  const auto frame = std::make_shared<const Image>(std::move(made));
  NoteDisplay notes(options.quiet);
  ServerLink link(options.server, notes);
  ASSIGN_OR_RETURN(const v1::GetServerInfoResponse info, link.info());
  BenchReport report;
  report.device = info.device().name();
  report.sent_bytes = frame->bytes();
  progress.show("warming up");
  RETURN_IF_ERROR(warm_up(link, *frame));
  SessionOptions session;
  session.lookahead = options.lookahead;
  session.encoding = options.encoding;
  std::vector<std::unique_ptr<Load>> loads;
  for (uint32_t i = 0; i < options.sessions; ++i) {
    progress.show(absl::StrFormat("opening session %d of %d", i + 1, options.sessions));
    ASSIGN_OR_RETURN(Session opened, link.open_session(session));
    loads.push_back(std::make_unique<Load>(options, std::move(opened), frame));
  }
  const absl::Time begin = absl::Now();
  for (const auto& load : loads) load->start(begin);
  const double all = absl::ToDoubleSeconds(options.duration);
  for (double s = 0; s < all; s = absl::ToDoubleSeconds(absl::Now() - begin)) {
    uint64_t answered = 0;
    for (const auto& load : loads) answered += load->answered();
    if (std::all_of(loads.begin(), loads.end(), [](const auto& load) { return load->ended(); })) break;
    progress.show_bar(s / all, absl::StrFormat("%d frames, %.1f per second, %.0f s left", answered,
                                               s > 0 ? static_cast<double>(answered) / s : 0, all - s));
    absl::SleepFor(absl::Seconds(std::min(0.2, std::max(0.001, all - s))));
  }
  progress.show("waiting for the last images");
  absl::Status status;
  for (const auto& load : loads) {
    status.Update(load->finish());
    report.returned_bytes += load->returned_bytes();
    report.sessions.push_back(load->take_result());
  }
  report.seconds = all;
  loads.clear();
  if (!status.ok()) return status;
  return report;
}

absl::Status run_bench(const BenchOptions& options, JsonOutput& json) {
  RETURN_IF_ERROR(check_outputs_apart(files_of(options.server), {{options.json, "the JSON"}}));
  RETURN_IF_ERROR(json.open());
  Progress progress(!options.quiet);
  const absl::StatusOr<BenchReport> report = measure(options, progress);
  progress.clear();
  if (!report.ok()) return report.status();
  if (!options.quiet && !json.to_stdout()) {
    RETURN_IF_ERROR(print(to_text(options, *report)));
  }
  return json.write(to_json(options, *report));
}

constexpr char kBenchExamples[] =
    "Examples:\n"
    "  candela bench --server 127.0.0.1:50051 --sessions 4 --size 1280x720\n"
    "  candela bench --server 127.0.0.1:50051 --fps 24 --seconds 60 --json figures.json";

Finish define_bench(CLI::App& app) {
  const auto options = std::make_shared<BenchOptions>();
  add_bench_options(app, *options);
  return [options](const GivenOptions&) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_server_options(options->server));
    return parsed_command(*options, run_bench);
  };
}

}  // namespace

const Command kBenchCommand{"bench", "Measures a server under the load of several sessions.", kBenchExamples,
                            define_bench};

}  // namespace candela
