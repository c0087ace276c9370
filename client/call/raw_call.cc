#include "client/call/raw_call.h"

#include <algorithm>

namespace candela {

RawCall::RawCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                 absl::Time deadline) {
  if (deadline != absl::InfiniteFuture()) context_.set_deadline(absl::ToChronoTime(deadline));
  stream_ = grpc::GenericStub(channel).PrepareCall(&context_, method, &queue_);
  stream_->StartCall(this);
  started_ = wait();
}

RawCall::~RawCall() {
  if (!finished_) {
    context_.TryCancel();
    finish();
  }
  queue_.Shutdown();
  void* tag = nullptr;
  bool ok = false;
  while (queue_.Next(&tag, &ok)) {
  }
}

// Only one operation is in progress at a time, so the next event is its end.
bool RawCall::wait() {
  void* tag = nullptr;
  bool ok = false;
  return queue_.Next(&tag, &ok) && ok;
}

bool RawCall::write(const grpc::ByteBuffer& message) {
  if (!started_) return false;
  stream_->Write(message, this);
  const bool ok = wait();
  connected_ |= ok;
  return ok;
}

bool RawCall::half_close() {
  if (!started_) return false;
  stream_->WritesDone(this);
  return wait();
}

bool RawCall::read(grpc::ByteBuffer& message) {
  if (!started_) return false;
  stream_->Read(&message, this);
  return wait();
}

grpc::Status RawCall::finish() {
  grpc::Status status;
  stream_->Finish(&status, this);
  wait();
  finished_ = true;
  connected_ |= !status.error_details().empty();
  return status;
}

bool send_bands(RawCall& call, v1::BandKind kind, uint64_t row_bytes, std::span<const std::byte> pixels) {
  const uint64_t height = pixels.size() / row_bytes;
  const uint64_t rows = rows_of_band(row_bytes);
  for (uint64_t y = 0; y < height; y += rows) {
    const grpc::Slice band(pixels.data() + y * row_bytes, std::min(rows, height - y) * row_bytes);
    if (!call.write(v1::make_band(kind, static_cast<uint32_t>(y), band))) return false;
  }
  return true;
}

absl::Status end_of(RawCall& call, const Peer& peer) {
  const grpc::Status status = call.finish();
  return from_grpc(status, peer, call.connected());
}

}  // namespace candela
