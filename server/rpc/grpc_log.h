// Redirection of gRPC's own log messages.
#pragma once

namespace candela {

// Sends gRPC's messages to the server's log at level debug instead of to stderr. Important ones also reach
// the caller as a status. Affects the whole process. Call it once, before gRPC is used.
void send_grpc_messages_to_log();

}  // namespace candela
