#include "server/rpc/grpc_log.h"

#include <grpc/support/log.h>

#include <map>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "server/base/clock.h"
#include "server/base/log.h"

namespace candela {
namespace {

// Lets one message a second pass for each place of gRPC's source: a client can provoke errors without end.
class Places {
 public:
  // The number of messages of this place since the last one that was logged, this one included. Nothing if
  // this one is not to be logged.
  std::optional<uint64_t> pass(const char* file, int line) {
    const absl::MutexLock lock(&mutex_);
    return places_[{file, line}].pass(absl::Now());
  }

 private:
  absl::Mutex mutex_;
  std::map<std::pair<const char*, int>, OneASecond> places_ ABSL_GUARDED_BY(mutex_);  // as many as gRPC has
};

void log_message(gpr_log_func_args* message) {
  static Places& places = *new Places;  // gRPC's threads log until the process ends
  const std::optional<uint64_t> messages = places.pass(message->file, message->line);
  if (!messages) return;
  const bool error = message->severity == GPR_LOG_SEVERITY_ERROR;
  log_event(error ? LogLevel::kError : LogLevel::kDebug, "grpc",
            {{"file", message->file},
             {"line", static_cast<int64_t>(message->line)},
             {"message", message->message},
             {"left_out", *messages - 1}});
}

}  // namespace

void send_grpc_messages_to_log() { gpr_set_log_function(log_message); }

}  // namespace candela
