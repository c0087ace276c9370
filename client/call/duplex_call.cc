#include "client/call/duplex_call.h"

#include "client/call/wire.h"
#include "server/base/check.h"

namespace candela {

DuplexCall::DuplexCall(CallQueue& queue, const std::shared_ptr<grpc::Channel>& channel, Peer peer,
                       const std::string& method, const Metadata& metadata)
    : peer_(std::move(peer)) {
  for (const auto& [key, value] : metadata) context_.AddMetadata(key, value);
  stream_ = grpc::GenericStub(channel).PrepareCall(&context_, method, &queue.completions());
  stream_->StartCall(&start_);
}

DuplexCall::~DuplexCall() { CHECK(ended_); }

std::optional<CallEvent> DuplexCall::on_start(bool ok) {
  writing_ = false;
  writable_ = ok;
  if (ok) read();
  read_over_ = !ok;
  finish_if_over();
  return CallEvent::kWritable;
}

std::optional<CallEvent> DuplexCall::on_read(bool ok) {
  if (ok) return CallEvent::kMessage;
  read_over_ = true;
  finish_if_over();
  return std::nullopt;
}

std::optional<CallEvent> DuplexCall::on_write(bool ok) {
  writing_ = false;
  connected_ |= ok;
  writable_ &= ok;
  finish_if_over();
  return CallEvent::kWritable;
}

std::optional<CallEvent> DuplexCall::on_finish(bool) {
  ended_ = true;
  connected_ |= !status_.error_details().empty();
  return CallEvent::kEnded;
}

// A write in progress fails soon after the last read.
void DuplexCall::finish_if_over() {
  if (!read_over_ || writing_ || finishing_) return;
  writable_ = false;
  finishing_ = true;
  stream_->Finish(&status_, &finish_);
}

void DuplexCall::write(const grpc::ByteBuffer& message) {
  CHECK(can_write());
  writing_ = true;
  stream_->Write(message, &write_);
}

void DuplexCall::half_close() {
  CHECK(can_write());
  writing_ = true;
  stream_->WritesDone(&write_);
}

absl::Status DuplexCall::error() const { return from_grpc(status_, peer_, connected_); }

}  // namespace candela
