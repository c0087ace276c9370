#include "client/call/duplex_call.h"

#include <chrono>

#include "server/base/check.h"

namespace candela {

DuplexCall::DuplexCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                       const Metadata& metadata) {
  for (const auto& [key, value] : metadata) context_.AddMetadata(key, value);
  stream_ = grpc::GenericStub(channel).PrepareCall(&context_, method, &queue_);
  writing_ = true;  // until the call has started
  stream_->StartCall(tag(kStart));
}

DuplexCall::~DuplexCall() {
  cancel();
  while (!ended_) wait();
  queue_.Shutdown();
  void* any = nullptr;
  bool ok = false;
  while (queue_.Next(&any, &ok)) {
  }
}

DuplexCall::Event DuplexCall::wait(absl::Time until) {
  if (ended_) return Event::kEnded;
  if (read_due_) read();
  while (true) {
    void* any = nullptr;
    bool ok = false;
    const auto next = queue_.AsyncNext(&any, &ok, absl::ToChronoTime(until));
    if (next != grpc::CompletionQueue::GOT_EVENT) return Event::kTimeout;
    switch (static_cast<Tag>(reinterpret_cast<intptr_t>(any))) {
      case kStart:
        writing_ = false;
        writable_ = ok;
        if (ok) read();
        read_over_ = !ok;
        finish_if_over();
        return Event::kWritable;
      case kRead:
        if (ok) {
          read_due_ = true;
          return Event::kMessage;
        }
        read_over_ = true;
        finish_if_over();
        break;
      case kWrite:
        writing_ = false;
        connected_ |= ok;
        writable_ &= ok;
        finish_if_over();
        return Event::kWritable;
      case kFinish:
        ended_ = true;
        connected_ |= !status_.error_details().empty();
        return Event::kEnded;
      case kWake: {
        const absl::MutexLock lock(&mutex_);
        waking_ = false;
        return Event::kWoken;
      }
    }
  }
}

void DuplexCall::read() {
  read_due_ = false;
  stream_->Read(&message_, tag(kRead));
}

// A write in progress fails soon after the last read.
void DuplexCall::finish_if_over() {
  if (!read_over_ || writing_ || finishing_) return;
  writable_ = false;
  finishing_ = true;
  stream_->Finish(&status_, tag(kFinish));
}

void DuplexCall::write(const grpc::ByteBuffer& message) {
  CHECK(can_write());
  writing_ = true;
  stream_->Write(message, tag(kWrite));
}

void DuplexCall::half_close() {
  CHECK(can_write());
  writing_ = true;
  stream_->WritesDone(tag(kWrite));
}

void DuplexCall::wake() {
  const absl::MutexLock lock(&mutex_);
  if (waking_) return;
  waking_ = true;
  alarm_ = std::make_unique<grpc::Alarm>(&queue_, std::chrono::system_clock::now(), tag(kWake));
}

}  // namespace candela
