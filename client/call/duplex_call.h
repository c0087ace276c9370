// A ClientCall over gRPC.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/call/call_queue.h"
#include "client/security.h"

namespace candela {

// Its events come from its queue, which has one call at a time. Lives until kEnded at least.
class DuplexCall final : public ClientCall {
 public:
  using Metadata = std::vector<std::pair<std::string, std::string>>;

  // `method` is "/package.Service/Method". `queue` outlives it.
  DuplexCall(CallQueue& queue, const std::shared_ptr<grpc::Channel>& channel, Peer peer,
             const std::string& method, const Metadata& metadata);
  ~DuplexCall() override;
  DuplexCall(const DuplexCall&) = delete;
  DuplexCall& operator=(const DuplexCall&) = delete;

  bool can_write() const override { return writable_ && !writing_; }
  bool writing() const override { return writing_; }
  void write(const grpc::ByteBuffer& message) override;
  void half_close() override;
  grpc::ByteBuffer& message() override { return message_; }
  void read() override { stream_->Read(&message_, &read_); }
  void cancel() override { context_.TryCancel(); }
  const grpc::Status& status() const override { return status_; }
  bool connected() const override { return connected_; }
  absl::Status error() const override;

 private:
  // What a member does when an operation is over.
  class Operation final : public CallOperation {
   public:
    using Then = std::optional<CallEvent> (DuplexCall::*)(bool ok);
    Operation(DuplexCall& call, Then then) : call_(call), then_(then) {}
    std::optional<CallEvent> done(bool ok) override { return (call_.*then_)(ok); }

   private:
    DuplexCall& call_;
    const Then then_;
  };

  std::optional<CallEvent> on_start(bool ok);
  std::optional<CallEvent> on_read(bool ok);
  std::optional<CallEvent> on_write(bool ok);
  std::optional<CallEvent> on_finish(bool ok);
  void finish_if_over();

  const Peer peer_;
  Operation start_{*this, &DuplexCall::on_start};
  Operation read_{*this, &DuplexCall::on_read};
  Operation write_{*this, &DuplexCall::on_write};
  Operation finish_{*this, &DuplexCall::on_finish};
  grpc::ClientContext context_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> stream_;
  grpc::ByteBuffer message_;
  grpc::Status status_;
  bool writable_ = false;
  bool writing_ = true;  // until the call has started
  bool connected_ = false;
  bool read_over_ = false;
  bool finishing_ = false;
  bool ended_ = false;
};

}  // namespace candela
