// gRPC behind a session's calls: the queue, one call, and the channels to the servers.
#pragma once

#include <grpcpp/alarm.h>
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/call/client_call.h"
#include "client/security.h"
#include "client/session_driver.h"

namespace candela {

// The events of gRPC calls, for the one thread that drives them.

// An operation of a call. Its address is gRPC's tag for it.
class CallOperation {
 public:
  virtual ~CallOperation() = default;
  // The operation is over. Returns what that means to the driver of the call, if anything.
  virtual std::optional<CallEvent> done(bool ok) = 0;
};

// Outlives its calls. One thread uses it; any thread may call wake().
class CallQueue {
 public:
  CallQueue() = default;
  ~CallQueue();
  CallQueue(const CallQueue&) = delete;
  CallQueue& operator=(const CallQueue&) = delete;

  // Waits for the next event.
  CallEvent next(absl::Time until = absl::InfiniteFuture());

  // Makes the current or the next next() return kWoken.
  void wake();

  // For operations. Their tags are CallOperations.
  grpc::CompletionQueue& completions() { return queue_; }

 private:
  grpc::CompletionQueue queue_;
  absl::Mutex mutex_;
  std::unique_ptr<grpc::Alarm> alarm_ ABSL_GUARDED_BY(mutex_);
  bool waking_ ABSL_GUARDED_BY(mutex_) = false;
};

// A ClientCall over gRPC.
//
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

// The servers of a session at the ends of gRPC's channels.

struct SessionServer {
  std::shared_ptr<grpc::Channel> channel;
  Peer peer;
};

// One thread uses it; any thread may call wake().
class ChannelServers final : public SessionServers {
 public:
  explicit ChannelServers(std::vector<SessionServer> servers);

  size_t count() const override { return servers_.size(); }
  const std::string& address(size_t server) const override { return servers_[server].peer.address; }
  std::unique_ptr<ClientCall> call(size_t server, const std::string& session) override;
  void put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time deadline) override;

  // Waits for the next event, and gives it to the driver.
  void pass_on(SessionDriver& driver);
  // The driver gets CallEvent::kWoken.
  void wake() { queue_.wake(); }

 private:
  const std::vector<SessionServer> servers_;
  std::function<absl::StatusOr<v1::Environment>()> put_;  // pass_on() calls it next; null: nothing to put
  CallQueue queue_;
};

}  // namespace candela
