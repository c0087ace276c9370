#include <CLI/App.hpp>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <memory>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/commands/bench/bench_report.h"
#include "client/cli/commands/commands.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/bench_options.h"
#include "client/cli/options/command_line.h"
#include "client/cli/options/server_options.h"
#include "client/cli/results/run_display.h"
#include "client/image/sample.h"
#include "client/run/frame_files.h"
#include "client/run/output_files.h"
#include "client/run/report.h"
#include "client/run/server_link.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

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
