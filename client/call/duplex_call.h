// One gRPC call of raw messages in both directions at once, driven by the thread that has it.
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

// All members but wake() belong to one thread.
class DuplexCall {
 public:
  using Metadata = std::vector<std::pair<std::string, std::string>>;

  // `method` as "/package.Service/Method".
  DuplexCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
             const Metadata& metadata);
  // Cancels a call that has not ended, and waits for its end.
  ~DuplexCall();
  DuplexCall(const DuplexCall&) = delete;
  DuplexCall& operator=(const DuplexCall&) = delete;

  enum class Event {
    kTimeout,   // `until` has come
    kWoken,     // wake() was called
    kWritable,  // can_write() may have become true
    kMessage,   // message() is the next one
    kEnded,     // status() says how; nothing else comes
  };
  Event wait(absl::Time until = absl::InfiniteFuture());

  // Whether a write may be started: the one before is done and the call goes on.
  bool can_write() const { return writable_ && !writing_; }
  // Whether a write is under way: gRPC has not passed all of it on yet.
  bool writing() const { return writing_; }
  void write(const grpc::ByteBuffer& message);
  void half_close();  // as the last write

  grpc::ByteBuffer& message() { return message_; }
  const grpc::Status& status() const { return status_; }

  // Whether the server was reached: a message went out to it.
  bool connected() const { return connected_; }

  // The call ends soon.
  void cancel() { context_.TryCancel(); }

  // wait() returns at once, this time or the next. Any thread.
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
