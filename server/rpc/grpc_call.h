// The transport that gRPC is.
#pragma once

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <memory>

#include "absl/functional/function_ref.h"
#include "server/rpc/call_transport.h"
#include "server/rpc/server_call.h"

namespace candela {

using GrpcReactor = grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>;

// Begins the call that `begin` makes for its transport, and returns what gRPC's handler has to return. gRPC's
// reactions reach the call from then on.
GrpcReactor* serve_call(grpc::CallbackServerContext* context,
                        absl::FunctionRef<std::shared_ptr<ServerCall>(CallTransport&)> begin);

}  // namespace candela
