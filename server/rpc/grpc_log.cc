#include "server/rpc/grpc_log.h"

#include <grpc/support/log.h>

#include "server/base/log.h"

namespace candela {

void send_grpc_messages_to_log() {
  gpr_set_log_function([](gpr_log_func_args* message) {
    log_event(LogLevel::kDebug, "grpc", {{"file", message->file}, {"message", message->message}});
  });
}

}  // namespace candela
