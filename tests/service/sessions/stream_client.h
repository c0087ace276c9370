// A client of one Stream call through the generated classes. The test controls every message.
#pragma once

#include <grpcpp/grpcpp.h>

#include <deque>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "candela/v1/render.grpc.pb.h"
#include "tests/support/scenes.h"

namespace candela::testing {

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

}  // namespace candela::testing
