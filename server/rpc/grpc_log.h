// Redirection of gRPC's own log messages.
#pragma once

namespace candela {

// Sends gRPC's messages to the server's log instead of to stderr: errors as errors, all others at level
// debug. Each place of gRPC's source gets one line a second, and the line says how many it leaves out.
// Affects the whole process. Call it once, before gRPC is used.
void send_grpc_messages_to_log();

}  // namespace candela
