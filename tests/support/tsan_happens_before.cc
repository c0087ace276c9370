// Shows the thread sanitizer the mutexes of the system's Abseil and gRPC. Only for builds with that
// sanitizer.
//
// These libraries are not instrumented, so the sanitizer does not know what their locks order. That applies
// to our own absl::Mutex and to the locks by which gRPC passes a call between its threads. This file replaces
// the exported functions, for us and for the libraries. Each replacement tells the sanitizer what the
// function orders and calls the real one. The sanitizer ignores the memory that the real function itself
// uses, and the conditions that it evaluates for others.
#include <dlfcn.h>
#include <grpc/grpc.h>
#include <sanitizer/tsan_interface.h>

#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"

// NOLINTBEGIN: the sanitizer's names
extern "C" {
void AnnotateIgnoreReadsBegin(const char* file, int line);
void AnnotateIgnoreReadsEnd(const char* file, int line);
void AnnotateIgnoreWritesBegin(const char* file, int line);
void AnnotateIgnoreWritesEnd(const char* file, int line);
}
// NOLINTEND

namespace {

class Ignoring {
 public:
  Ignoring() {
    AnnotateIgnoreReadsBegin(__FILE__, __LINE__);
    AnnotateIgnoreWritesBegin(__FILE__, __LINE__);
  }
  ~Ignoring() {
    AnnotateIgnoreWritesEnd(__FILE__, __LINE__);
    AnnotateIgnoreReadsEnd(__FILE__, __LINE__);
  }
};

template <typename Function>
Function real(const char* symbol) {
  void* found = dlsym(RTLD_NEXT, symbol);
  if (found == nullptr) __builtin_trap();
  return reinterpret_cast<Function>(found);
}

// Calls the real `symbol` on `object`. It releases `mutex` to those that acquire it later, and acquires it
// from those that released it before.
template <typename Result, typename Object, typename... Arguments>
Result across(const void* mutex, Result (*call)(Object*, Arguments...), Object* object,
              Arguments... arguments) {
  struct Acquire {
    const void* mutex;
    ~Acquire() { __tsan_acquire(const_cast<void*>(mutex)); }
  } acquire{mutex};
  __tsan_release(const_cast<void*>(mutex));
  Ignoring ignoring;
  return call(object, arguments...);
}

// Locks with the real `call`.
void lock_by(void (*call)(absl::Mutex*), absl::Mutex* mutex) {
  {
    Ignoring ignoring;
    call(mutex);
  }
  __tsan_acquire(mutex);
}

void unlock_by(void (*call)(absl::Mutex*), absl::Mutex* mutex) {
  __tsan_release(mutex);
  Ignoring ignoring;
  call(mutex);
}

}  // namespace

#define CANDELA_REAL(symbol, ...) static const auto call = real<__VA_ARGS__>(symbol)

#define CANDELA_PREFIX "_ZN4absl7debian3"

namespace absl {

ABSL_NAMESPACE_BEGIN

void Mutex::Lock() {
  CANDELA_REAL(CANDELA_PREFIX "5Mutex4LockEv", void (*)(Mutex*));
  lock_by(call, this);
}

void Mutex::Unlock() {
  CANDELA_REAL(CANDELA_PREFIX "5Mutex6UnlockEv", void (*)(Mutex*));
  unlock_by(call, this);
}

bool Mutex::TryLock() {
  CANDELA_REAL(CANDELA_PREFIX "5Mutex7TryLockEv", bool (*)(Mutex*));
  bool locked = false;
  {
    Ignoring ignoring;
    locked = call(this);
  }
  if (locked) __tsan_acquire(this);
  return locked;
}

void Mutex::ReaderLock() {
  CANDELA_REAL(CANDELA_PREFIX "5Mutex10ReaderLockEv", void (*)(Mutex*));
  lock_by(call, this);
}

void Mutex::ReaderUnlock() {
  CANDELA_REAL(CANDELA_PREFIX "5Mutex12ReaderUnlockEv", void (*)(Mutex*));
  unlock_by(call, this);
}

void Mutex::Await(const Condition& condition) {
  CANDELA_REAL(CANDELA_PREFIX "5Mutex5AwaitERKNS0_9ConditionE", void (*)(Mutex*, const Condition*));
  across<void>(this, call, this, &condition);
}

bool Mutex::AwaitWithTimeout(const Condition& condition, Duration timeout) {
  CANDELA_REAL(CANDELA_PREFIX "5Mutex16AwaitWithTimeoutERKNS0_9ConditionENS0_8DurationE",
               bool (*)(Mutex*, const Condition*, Duration));
  return across<bool>(this, call, this, &condition, timeout);
}

bool Mutex::AwaitWithDeadline(const Condition& condition, Time deadline) {
  CANDELA_REAL(CANDELA_PREFIX "5Mutex17AwaitWithDeadlineERKNS0_9ConditionENS0_4TimeE",
               bool (*)(Mutex*, const Condition*, Time));
  return across<bool>(this, call, this, &condition, deadline);
}

void Mutex::LockWhen(const Condition& condition) {
  CANDELA_REAL(CANDELA_PREFIX "5Mutex8LockWhenERKNS0_9ConditionE", void (*)(Mutex*, const Condition*));
  across<void>(this, call, this, &condition);
}

void CondVar::Wait(Mutex* mutex) {
  CANDELA_REAL(CANDELA_PREFIX "7CondVar4WaitEPNS0_5MutexE", void (*)(CondVar*, Mutex*));
  across<void>(mutex, call, this, mutex);
}

bool CondVar::WaitWithTimeout(Mutex* mutex, Duration timeout) {
  CANDELA_REAL(CANDELA_PREFIX "7CondVar15WaitWithTimeoutEPNS0_5MutexENS0_8DurationE",
               bool (*)(CondVar*, Mutex*, Duration));
  return across<bool>(mutex, call, this, mutex, timeout);
}

bool CondVar::WaitWithDeadline(Mutex* mutex, Time deadline) {
  CANDELA_REAL(CANDELA_PREFIX "7CondVar16WaitWithDeadlineEPNS0_5MutexENS0_4TimeE",
               bool (*)(CondVar*, Mutex*, Time));
  return across<bool>(mutex, call, this, mutex, deadline);
}

ABSL_NAMESPACE_END
}  // namespace absl

// gRPC passes an operation through lock-free queues from the thread that starts it to the one that learns of
// its end. It releases the call before it tells us.
extern "C" {

grpc_call_error grpc_call_start_batch(grpc_call* on, const grpc_op* ops, size_t count, void* tag,
                                      void* reserved) {
  CANDELA_REAL("grpc_call_start_batch", grpc_call_error(*)(grpc_call*, const grpc_op*, size_t, void*, void*));
  __tsan_release(on);
  return call(on, ops, count, tag, reserved);
}

void grpc_call_unref(grpc_call* of) {
  CANDELA_REAL("grpc_call_unref", void (*)(grpc_call*));
  __tsan_acquire(of);
  call(of);
}

}  // namespace absl
