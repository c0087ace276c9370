#include "client/call/duplex_call.h"

#include <chrono>
#include <utility>

#include "client/call/channel.h"
#include "client/connection.h"
#include "server/base/check.h"

namespace candela {

CallQueue::~CallQueue() {
  queue_.Shutdown();
  void* any = nullptr;
  bool ok = false;
  while (queue_.Next(&any, &ok)) {
  }
}

CallEvent CallQueue::next(absl::Time until) {
  while (true) {
    void* tag = nullptr;
    bool ok = false;
    const auto next = queue_.AsyncNext(&tag, &ok, absl::ToChronoTime(until));
    if (next != grpc::CompletionQueue::GOT_EVENT) return CallEvent::kTimeout;
    if (tag == nullptr) {
      const absl::MutexLock lock(&mutex_);
      waking_ = false;
      return CallEvent::kWoken;
    }
    if (const auto event = static_cast<CallOperation*>(tag)->done(ok)) return *event;
  }
}

void CallQueue::wake() {
  const absl::MutexLock lock(&mutex_);
  if (waking_) return;
  waking_ = true;
  alarm_ = std::make_unique<grpc::Alarm>(&queue_, std::chrono::system_clock::now(), nullptr);
}

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

ChannelServers::ChannelServers(std::vector<SessionServer> servers) : servers_(std::move(servers)) {}

std::unique_ptr<ClientCall> ChannelServers::call(size_t server, const std::string& session) {
  const auto& [channel, peer] = servers_[server];
  return std::make_unique<DuplexCall>(queue_, channel, peer, "/candela.v1.RenderService/Stream",
                                      DuplexCall::Metadata{{"x-session-id", session}});
}

void ChannelServers::put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time deadline) {
  put_ = [this, server, panorama = std::move(panorama), deadline] {
    const auto& [channel, peer] = servers_[server];
    return Connection(channel, peer).put_environment(*panorama, deadline);
  };
}

void ChannelServers::pass_on(SessionDriver& driver) {
  if (put_) return driver.on_put(std::exchange(put_, nullptr)());
  driver.on_event(queue_.next(driver.deadline()));
}

}  // namespace candela
