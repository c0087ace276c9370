// Clients of a service under test: calls by hand, sessions of the library, neighbours, and a wire that can be
// cut.
#pragma once

#include <grpcpp/grpcpp.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "candela/v1/render.grpc.pb.h"
#include "client/session.h"
#include "tests/support/scenes.h"

namespace candela::testing {

// A TCP relay that can be cut or slowed down. It imitates a client that vanishes or has a slow connection.
//
// Relays one connection to 127.0.0.1:`port`.
class WireCutter {
 public:
  explicit WireCutter(const std::string& server_address);
  ~WireCutter();

  const std::string& address() const { return address_; }
  // From now on relays at most this many bytes a second to that side. The rest stays with the sender, except
  // for TCP's buffers.
  void slow_to_server(double bytes_per_second) { to_server_ = bytes_per_second; }
  void slow_to_client(double bytes_per_second) { to_client_ = bytes_per_second; }
  // That it has relayed.
  uint64_t bytes_to_client() const { return bytes_to_client_; }
  // Ends both connections at once with a reset.
  void cut();

 private:
  static constexpr double kUnlimited = 1e15;

  void run(int server_port);

  int listener_ = -1;
  std::string address_;
  std::atomic<bool> cut_ = false;
  std::atomic<double> to_server_ = kUnlimited;
  std::atomic<double> to_client_ = kUnlimited;
  std::atomic<uint64_t> bytes_to_client_ = 0;
  std::thread thread_;
};

// A client of one Stream call through the generated classes. The test controls every message.

// One frame's answer.
struct StreamResult {
  v1::ResultHeader header;
  std::string pixels;  // or the encoded file
  bool failed = false;
  v1::FrameFailure failure;

  const std::string& token() const { return failed ? failure.resume_token() : header.resume_token(); }
  uint64_t sequence() const { return failed ? failure.sequence() : header.sequence(); }
};

class StreamClient {
 public:
  // A thread reads messages as they come, as every client of a stream must. If `reads` is false, only read(),
  // read_all() and finish() read.
  explicit StreamClient(const std::shared_ptr<grpc::Channel>& channel, bool reads = true,
                        absl::Time deadline = absl::InfiniteFuture());
  ~StreamClient();

  // Returns false if the call is over.
  bool open(const v1::StreamOpen& open);
  bool open(const std::string& session, const v1::Settings& settings = {}, const std::string& token = "");
  bool send_header(const WireFrame& frame, uint64_t sequence, int64_t media_time_ns, bool cut = false,
                   uint32_t timeout_ms = 0);
  bool send_rows(const WireFrame& frame, uint32_t first, uint32_t count);
  // Sends the header and every row.
  bool send(const WireFrame& frame, uint64_t sequence, int64_t media_time_ns, bool cut = false,
            uint32_t timeout_ms = 0);
  bool change(uint64_t from_sequence, const v1::Settings& settings);
  void half_close() { stream_->WritesDone(); }

  // Reads the next frame's answer; false if there are no more.
  bool read(StreamResult& result);
  // Reads all answers until the end.
  std::vector<StreamResult> read_all();
  // Reads the remaining messages and returns the call's status.
  grpc::Status finish();
  void cancel() { context_.TryCancel(); }

  const v1::StreamOpened& opened() const { return opened_; }  // after the first read
  bool told_to_go_away() const { return go_away_; }

 private:
  bool next(v1::StreamResponse& response);

  grpc::ClientContext context_;
  std::unique_ptr<v1::RenderService::Stub> stub_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::StreamRequest, v1::StreamResponse>> stream_;
  v1::StreamOpened opened_;
  bool go_away_ = false;
  bool finished_ = false;
  absl::Mutex mutex_;
  std::deque<v1::StreamResponse> read_ ABSL_GUARDED_BY(mutex_);
  bool end_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread reader_;  // last: it uses all of the above
};

// Media time of frame `i` at 24 a second.
inline int64_t film_time_ns(uint64_t i) { return static_cast<int64_t>((i * 1'000'000'000 + 12) / 24); }

// Runs a whole session with `frames` at 24 a second.
std::vector<StreamResult> stream_all(const std::shared_ptr<grpc::Channel>& channel,
                                     const v1::StreamOpen& open, const std::vector<WireFrame>& frames);

v1::StreamOpen open_of(const std::string& session, const v1::Settings& settings = {});

// Runs a client's whole session in one call, for tests that disturb its server meanwhile.

using Film = std::shared_ptr<const std::vector<WireFrame>>;

// Noise with varying brightness, so that each frame's exposure depends on the frames before it.
Film make_film(size_t frames, uint32_t width, uint32_t height);

// Frame `i`, ready to submit, at 24 frames a second of media time.
SessionFrame frame_of(const Film& film, size_t i);

struct SessionRun {
  absl::Status status;              // the session's
  std::vector<std::string> images;  // of the frames in their order; each came once and did not fail
  std::vector<v1::ResultHeader> headers;
  SessionStats stats;

  std::vector<double> exposures() const {
    std::vector<double> all;
    for (const v1::ResultHeader& header : headers) all.push_back(header.exposure());
    return all;
  }
};

// Streams the frames `first` .. `last` - 1 as fast as the session accepts them, and takes the results. Calls
// `on_result` after each result with the number of results so far.
SessionRun run_frames(absl::StatusOr<Session> session, size_t first, size_t last,
                      const std::function<SessionFrame(size_t)>& frame,
                      const std::function<void(size_t)>& on_result = {});

// The same for all frames of a film.
SessionRun run_session(absl::StatusOr<Session> session, const Film& film,
                       const std::function<void(size_t)>& on_result = {});

// Clients beside the one that a test is about.

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
