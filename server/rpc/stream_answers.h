// The messages that a stream sends: notices and the answers to its frames.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "candela/v1/render.pb.h"
#include "server/base/clock.h"
#include "server/rpc/wire/result_writer.h"
#include "server/session/resume_token.h"
#include "server/session/session_frames.h"
#include "server/session/stream_start.h"

namespace candela {

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

}  // namespace candela
