// A gRPC call that sends and receives raw messages at the same time, driven by the thread that owns it.
#pragma once

#include <grpcpp/alarm.h>
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"

namespace candela {

// One thread uses all members; any thread may call wake().
class DuplexCall {
 public:
  using Metadata = std::vector<std::pair<std::string, std::string>>;

  // `method` is "/package.Service/Method".
  DuplexCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
             const Metadata& metadata);
  // Cancels the call unless it has ended, and waits for its end.
  ~DuplexCall();
  DuplexCall(const DuplexCall&) = delete;
  DuplexCall& operator=(const DuplexCall&) = delete;

  enum class Event {
    kTimeout,   // `until` has passed
    kWoken,     // wake() was called
    kWritable,  // can_write() may be true now
    kMessage,   // message() holds the next message
    kEnded,     // status() says how; no other event follows
  };
  // Waits for the next event.
  Event wait(absl::Time until = absl::InfiniteFuture());

  // Whether a write may start: the previous one is done and the call continues.
  bool can_write() const { return writable_ && !writing_; }
  // Whether a write is in progress: gRPC has not passed all of it on yet.
  bool writing() const { return writing_; }
  void write(const grpc::ByteBuffer& message);
  void half_close();  // takes the place of a write; none may follow

  grpc::ByteBuffer& message() { return message_; }
  const grpc::Status& status() const { return status_; }

  // True if the server was reached: a message was sent to it, or it refused the call with details, which may
  // come before the first message is sent. Final after the call's end.
  bool connected() const { return connected_; }

  // Asks gRPC to end the call; kEnded follows soon.
  void cancel() { context_.TryCancel(); }

  // Makes the current or the next wait() return at once.
  void wake();

 private:
  enum Tag : int { kStart, kRead, kWrite, kFinish, kWake };
  static void* tag(Tag tag) { return reinterpret_cast<void*>(static_cast<intptr_t>(tag)); }
  void read();
  void finish_if_over();

  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> stream_;
  grpc::ByteBuffer message_;
  grpc::Status status_;
  bool writable_ = false;
  bool writing_ = false;
  bool connected_ = false;
  bool read_due_ = false;
  bool read_over_ = false;
  bool finishing_ = false;
  bool ended_ = false;
  absl::Mutex mutex_;
  std::unique_ptr<grpc::Alarm> alarm_ ABSL_GUARDED_BY(mutex_);
  bool waking_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace candela
