#include "server/rpc/stream_answers.h"

#include <utility>

#include "proto/candela/v1/message_wire.h"
#include "server/session/exposure_state.h"

namespace candela {

StreamAnswers::StreamAnswers(const TokenKeys& keys, const StreamStart& start, uint64_t epoch,
                             std::string device, Clock& clock)
    : keys_(keys),
      session_(start.session),
      epoch_(epoch),
      encoding_(start.encoding),
      return_state_(start.return_state),
      device_(std::move(device)),
      clock_(clock) {}

void StreamAnswers::notify(const v1::StreamResponse& notice) { notices_.push_back(v1::pack(notice)); }

bool StreamAnswers::next(SessionFrames& frames, grpc::ByteBuffer& message) {
  if (writer_) {
    if (writer_->next(message)) return true;
    writer_.reset();
    frames.pop();
  }
  if (!notices_.empty()) {
    message.Swap(&notices_.front());
    notices_.pop_front();
    return true;
  }
  const SessionFrames::EntryPtr due = frames.due();
  if (due == nullptr) return false;
  const ExposurePoint& exposure = frames.answer(*due);
  if (due->stage == SessionFrames::Stage::kFailed) {
    message = failure(*due, exposure);
    frames.pop();
    return true;
  }
  if (encoding_ == v1::ENCODING_NONE || due->frame->image_in_memory) {
    writer_.emplace(std::make_shared<const std::string>(), result(*due, exposure));
  } else if (due->file != nullptr) {
    writer_.emplace(due->file, result(*due, exposure));
  } else {
    writer_.emplace(due->frame, result(*due, exposure),
                    leaves_out_alpha(*due->frame, due->layout, *due->report));
  }
  return writer_->next(message);
}

std::string StreamAnswers::token(const SessionFrames::Entry& frame, const ExposurePoint& exposure) const {
  return keys_.seal({.session = session_,
                     .epoch = epoch_,
                     .sequence = frame.token_sequence,
                     .exposure = exposure,
                     .settings_hash = frame.settings_hash},
                    clock_.now());
}

grpc::ByteBuffer StreamAnswers::result(const SessionFrames::Entry& frame,
                                       const ExposurePoint& exposure) const {
  v1::StreamResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header = result_header(*frame.frame, frame.layout, {*frame.report, frame.queued}, device_);
  header.set_exposure_before(frame.exposure.before);
  header.set_cut(frame.exposure.cut);
  header.set_resume_token(token(frame, exposure));
  if (return_state_) *header.mutable_state() = state_of(exposure);
  header.set_encoding(encoding_);
  if (frame.file != nullptr) header.set_encoded_bytes(frame.file->size());
  header.set_alpha_left_out(encoding_ == v1::ENCODING_RAW &&
                            leaves_out_alpha(*frame.frame, frame.layout, *frame.report));
  return v1::pack(response);
}

grpc::ByteBuffer StreamAnswers::failure(const SessionFrames::Entry& frame,
                                        const ExposurePoint& exposure) const {
  v1::StreamResponse response;
  v1::FrameFailure& failure = *response.mutable_failure();
  failure.set_sequence(frame.sequence);
  failure.set_code(static_cast<uint32_t>(frame.failure.code()));
  failure.set_message(std::string(frame.failure.message()));
  failure.set_resume_token(token(frame, exposure));
  return v1::pack(response);
}

}  // namespace candela
