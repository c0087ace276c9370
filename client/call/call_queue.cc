#include "client/call/call_queue.h"

#include <chrono>

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

}  // namespace candela
