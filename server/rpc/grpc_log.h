// gRPC's own messages.
#pragma once

namespace candela {

// Into our log at the debug level, instead of onto stderr in gRPC's format: what matters of them, a caller
// also gets as a status. For the whole process; call once, before gRPC is used.
void send_grpc_messages_to_log();

}  // namespace candela
