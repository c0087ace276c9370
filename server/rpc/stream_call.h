// A session's call: the protocol, uploads, frames and answers.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "server/base/clock.h"
#include "server/rpc/admission.h"
#include "server/rpc/band_reader.h"
#include "server/rpc/result_writer.h"
#include "server/rpc/server_call.h"
#include "server/rpc/service_state.h"
#include "server/session/resume_token.h"
#include "server/session/session_frames.h"
#include "server/session/sessions.h"
#include "server/session/stream_start.h"

namespace candela {

// The messages that a stream sends: notices and the answers to its frames.
//
// Answers come in the order of the frames, each one whole. A notice is sent before the next answer. Not
// thread-safe.
class StreamAnswers {
 public:
  // `keys` and `clock` outlive this object. `device` is the name of the Vulkan device.
  StreamAnswers(const TokenKeys& keys, const StreamStart& start, uint64_t epoch, std::string device,
                Clock& clock);

  void notify(const v1::StreamResponse& notice);

  // Puts the next message into `message` and forgets each frame of `frames` whose answer is complete. Returns
  // false if nothing can be sent yet.
  bool next(SessionFrames& frames, grpc::ByteBuffer& message);

  // The call has ended: releases the memory of the frame that was being sent.
  void end() { writer_.reset(); }

 private:
  grpc::ByteBuffer result(const SessionFrames::Entry& frame, const ExposurePoint& exposure) const;
  grpc::ByteBuffer failure(const SessionFrames::Entry& frame, const ExposurePoint& exposure) const;
  std::string token(const SessionFrames::Entry& frame, const ExposurePoint& exposure) const;

  const TokenKeys& keys_;
  const std::string session_;
  const uint64_t epoch_;
  const v1::Encoding encoding_;
  const bool return_state_;
  const std::string device_;
  Clock& clock_;
  std::deque<grpc::ByteBuffer> notices_;
  std::optional<ResultWriter> writer_;  // of the first frame, while its result is sent
};

// One Stream call: the protocol of a session, from its open message to its last result.
//
// Reads, renders and writes at the same time. It reads one message at a time, in these states:
//
//   open -> between -> first band -> admission -> bands -> between ... -> closed
//           between -> passing -> between
//           between -> admission -> between         (a view, or pixels in the client's memory)
//
// SessionFrames holds the frames that were read and StreamAnswers sends their answers. The next message is
// read only if there is room for what it may bring, so HTTP/2 flow control holds the client back. The render
// thread and the encoders report the end of each stage of a frame.
class StreamCall final : public ServerCall, public SessionCall {
 public:
  // `state` outlives the call.
  static std::shared_ptr<ServerCall> begin(CallTransport& transport, ServiceState& state);

  void on_read_done(bool ok) override;
  void on_write_done(bool ok) override;

  void go_away() override;
  void give_up() override;

 private:
  enum class Reading { kOpen, kBetween, kFirstBand, kAdmission, kBands, kPassing, kClosed };
  using Entry = SessionFrames::Entry;
  using EntryPtr = SessionFrames::EntryPtr;

  // The members that exist from the open message on.
  struct Open {
    Open(OpenedSession opened, const ServiceState& state, ClientId client);

    OpenedSession session;
    SettingsTrack settings;
    SessionFrames frames;
    StreamAnswers answers;
  };

  StreamCall(CallTransport& transport, ServiceState& state);
  std::shared_ptr<StreamCall> self() { return std::static_pointer_cast<StreamCall>(shared_from_this()); }

  void on_entered() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_idle() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_finish(const absl::Status& status, const std::string& message) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Whether no more messages are read.
  bool ending() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return finished() || ending_; }

  // Reading.
  void read_on() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_message(grpc::ByteBuffer& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_open(const v1::StreamRequest& request) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_header(const v1::FrameHeader& header) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void admit() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // A frame that was answered before the session was resumed: its bands are read and dropped.
  absl::Status pass_over(const v1::FrameHeader& header, const WireLayout& layout)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_passed(grpc::ByteBuffer& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void end_passed() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void take_without_bands() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status idle_for(absl::Duration timeout) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Ends a call whose client is silent or too slow. That is no failure of this server, so its frames count as
  // cancelled.
  void give_up_on_client(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_admitted(absl::StatusOr<std::shared_ptr<Frame>> admitted) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_band(grpc::ByteBuffer& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_half_close() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Rendering.
  absl::Status submit(const EntryPtr& entry, Work work) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status submit_decided() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_worked(const EntryPtr& entry, Work work, absl::StatusOr<RenderedFrame> rendered)
      ABSL_LOCKS_EXCLUDED(mutex_);
  void on_rendered(const EntryPtr& entry, RenderedFrame rendered) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_encoded(const EntryPtr& entry, absl::StatusOr<std::string> file, absl::Duration took)
      ABSL_LOCKS_EXCLUDED(mutex_);

  void write_on() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Reads nothing more. Frames that were received completely are answered, unless they wait for later ones.
  // Then the call ends with `status`.
  void read_no_more(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // The same for a message that was refused before its frame had memory. Counts the refusal.
  void refuse(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Reads nothing more and releases `dropped`. The call ends with `status` once the other frames are
  // answered.
  void end_without(const SessionFrames::Entries& dropped, const absl::Status& status)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Counts the dropped frames that are not finished by `status`, and frees their memory. A frame that is
  // being rendered is finished and discarded, and releases its memory only then.
  void release(const SessionFrames::Entries& dropped, const absl::Status& status)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void log_failure(const Entry& entry, const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  ServiceState& state_;
  const Flow flow_;
  const ClientId client_;
  std::optional<ClientPresence::Visit> visit_ ABSL_GUARDED_BY(mutex_);
  grpc::ByteBuffer incoming_;  // belongs to the transport until on_read_done
  grpc::ByteBuffer outgoing_;  // belongs to the transport until on_write_done
  std::optional<Open> open_ ABSL_GUARDED_BY(mutex_);
  Admission admission_ ABSL_GUARDED_BY(mutex_);
  EnvironmentUse environment_
      ABSL_GUARDED_BY(mutex_);  // of the newest view; the session may use it until it ends
  std::optional<ClientPixels> shared_ ABSL_GUARDED_BY(mutex_);  // of the newest header
  uint64_t sequence_ ABSL_GUARDED_BY(mutex_) = 0;               // of the newest header
  std::optional<BandReader> bands_ ABSL_GUARDED_BY(mutex_);
  grpc::ByteBuffer first_band_ ABSL_GUARDED_BY(mutex_);  // waits for its frame's memory
  Reading reading_ ABSL_GUARDED_BY(mutex_) = Reading::kOpen;
  bool read_pending_ ABSL_GUARDED_BY(mutex_) = false;
  bool write_pending_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<absl::Status> ending_ ABSL_GUARDED_BY(mutex_);  // the status once all frames are answered
  absl::Time last_read_ ABSL_GUARDED_BY(mutex_);
  absl::Time last_write_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace candela
