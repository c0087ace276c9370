// One Render or Meter call, from its start message to its last band.
#pragma once

#include <grpcpp/alarm.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/rpc/backend.h"
#include "server/rpc/band_reader.h"
#include "server/rpc/render_start.h"
#include "server/rpc/result_writer.h"

namespace candela {

// gRPC's threads call the reactions, the render thread on_rendered, a timer's thread on_idle; the mutex is
// held for a band's memcpy at most.
//
//   start --> bands --> queued --> sending --> finished
//      \-> choosing -/
//
// `choosing` is for a start message with a promise instead of a tier: the render thread chooses.
// Every state may also end in `finished`: Finish is called there, once, and the frame is let go. Memory for
// the frame is reserved between the start message and the read that asks for the first band, so a client that
// is not admitted is held back by HTTP/2's flow control or refused, never buffered.
class RenderCall final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                         public std::enable_shared_from_this<RenderCall> {
 public:
  // Owns itself until gRPC is done with it. `backend` outlives it. kMeter answers with one MeterResponse.
  static RenderCall* begin(grpc::CallbackServerContext* context, Backend& backend, Work work);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

 private:
  enum class State { kStart, kChoosing, kBands, kQueued, kSending, kFinished };

  RenderCall(grpc::CallbackServerContext* context, Backend& backend, Work work);

  void enter() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_start() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status admit() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void choose_tier();
  absl::Status take_band() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status enqueue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_rendered(absl::StatusOr<RenderedFrame> rendered);
  void count_end(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void send_next() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void finish(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  void watch_idle(absl::Duration wait) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_idle();

  grpc::CallbackServerContext& context_;
  Backend& backend_;
  const Work work_;
  const Flow flow_;                   // its connection's
  std::shared_ptr<RenderCall> self_;  // until OnDone

  absl::Mutex mutex_;
  State state_ ABSL_GUARDED_BY(mutex_) = State::kStart;
  bool inside_ ABSL_GUARDED_BY(mutex_) = false;  // the gate
  grpc::ByteBuffer incoming_;                    // gRPC's between StartRead and OnReadDone
  grpc::ByteBuffer outgoing_;                    // gRPC's between StartWrite and OnWriteDone
  std::optional<RenderStart> start_ ABSL_GUARDED_BY(mutex_);
  std::string tier_reason_ ABSL_GUARDED_BY(mutex_);
  std::shared_ptr<Frame> frame_ ABSL_GUARDED_BY(mutex_);
  std::optional<BandReader> bands_ ABSL_GUARDED_BY(mutex_);
  Ticket ticket_ ABSL_GUARDED_BY(mutex_) = 0;
  std::optional<ResultWriter> result_ ABSL_GUARDED_BY(mutex_);
  const absl::Time begun_;
  absl::Time last_progress_ ABSL_GUARDED_BY(mutex_);
  std::unique_ptr<grpc::Alarm> idle_alarm_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace candela
