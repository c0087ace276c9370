// The result of `candela bench`, as text and as JSON.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "client/cli/options/options.h"

namespace candela {

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

// Divides the run into ten windows and returns the throughput of
// each, in frames per second over all sessions.
std::vector<double> window_rates(const BenchReport& report);

// True if the throughputs of the last three windows differ by at most 10 %.
bool is_stable(const BenchReport& report);

std::string to_text(const BenchOptions& options, const BenchReport& report);

// One line with the keys sessions, width, height, fps (null for max), seconds, server,
// device, transport (memory if all sessions shared it, else grpc), frames, dropped, failed, resumes,
// frames_per_second, megapixels_per_second, latency_ms {p50, p90, p99, p999, max}, queue_ms and device_ms
// {p50, p90, p99}, fairness {min_fps, max_fps, jain}, per_session_fps, window_fps, stable.
std::string to_json(const BenchOptions& options, const BenchReport& report);

}  // namespace candela
