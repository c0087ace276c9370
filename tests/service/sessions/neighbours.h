// Clients beside the one that a test is about.
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tests/service/sessions/stream_client.h"
#include "tests/support/scenes.h"

namespace candela::testing {

// The value that this part of `values` does not exceed.
double quantile(std::vector<double> values, double part);

// Repeats a call on a thread of its own while it lives and the test has not failed.
class Repeated {
 public:
  explicit Repeated(std::function<void()> call);
  ~Repeated();

 private:
  const std::function<void()> call_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;  // last: it uses the rest
};

// A session that sends one frame again and again, one at a time, and expects the same image each time.
class Bystander {
 public:
  explicit Bystander(const std::string& address, WireFrame frame = natural(160, 90),
                     absl::Time deadline = absl::InfiniteFuture());
  // Milliseconds from before the header until the whole result.
  double latency_ms();
  std::vector<double> latencies_ms(int frames, absl::Duration pause = absl::ZeroDuration());
  uint64_t answered() const { return answered_; }

 private:
  const WireFrame frame_;
  StreamClient client_;
  uint64_t answered_ = 0;
  std::string first_;
};

// A session that sends the same frame again and again, as fast as it is accepted, until stop().
class Load {
 public:
  Load(const std::string& address, const std::string& session, WireFrame frame);
  ~Load() { stop(); }

  void stop();
  void measure(bool on) { measuring_ = on; }
  uint64_t answered() const { return answered_; }
  double device_ns() const { return static_cast<double>(device_ns_); }  // valid after stop()

 private:
  const WireFrame frame_;
  StreamClient client_;
  std::atomic<bool> stop_ = false;
  std::atomic<bool> measuring_ = false;
  std::atomic<uint64_t> answered_ = 0;
  uint64_t device_ns_ = 0;
  std::thread sender_;
  std::thread receiver_;
};

}  // namespace candela::testing
