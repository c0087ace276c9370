// What `candela bench` measured, for people and for programs.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "client/cli/options/options.h"

namespace candela {

// One frame's way there and back.
struct BenchFrame {
  double done_s = 0;  // when its result was here, since the beginning
  double latency_ms = 0;
  double queue_ms = 0;   // waiting on the server
  double device_ms = 0;  // the other stages
};

// Of one session.
struct BenchSession {
  std::vector<BenchFrame> frames;  // in order
  uint64_t dropped = 0;            // not sent: the session had no room when they were due
  uint64_t failed = 0;             // with a failure of their own: late, mostly
  uint64_t resumes = 0;
};

struct BenchReport {
  std::vector<BenchSession> sessions;
  double seconds = 0;
  uint64_t sent_bytes = 0;      // of one frame
  uint64_t returned_bytes = 0;  // of all images
  std::string device;
};

// Throughput of each of ten windows of the time, in frames a second, all sessions together.
std::vector<double> window_rates(const BenchReport& report);

// Whether the last three windows are within 10 % of each other.
bool is_stable(const BenchReport& report);

std::string to_text(const BenchOptions& options, const BenchReport& report);

// One line: sessions, width, height, fps (null for max), seconds, server, device, frames, dropped, failed,
// resumes, frames_per_second, megapixels_per_second, latency_ms {p50, p90, p99, p999, max}, queue_ms and
// device_ms {p50, p90, p99}, fairness {min_fps, max_fps, jain}, per_session_fps, window_fps, stable.
std::string to_json(const BenchOptions& options, const BenchReport& report);

}  // namespace candela
