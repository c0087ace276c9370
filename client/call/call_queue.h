// The events of gRPC calls, for the one thread that drives them.
#pragma once

#include <grpcpp/alarm.h>
#include <grpcpp/completion_queue.h>

#include <memory>
#include <optional>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "client/call/client_call.h"

namespace candela {

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

}  // namespace candela
