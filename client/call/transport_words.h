// Plain words for what gRPC says in its own terms when its transport, and not a candelad, ended a call.
#pragma once

#include <grpcpp/support/status.h>

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace candela {

// Why the server at `address` cannot be reached, and what to do.
std::string unreachable_words(const std::string& address, absl::string_view grpc_message);

// Why the connection to a server is lost: "it closed the connection".
std::string loss_words(absl::string_view grpc_message);

// The error for a status that HTTP or gRPC itself gave the call, such as "Received http2 header with status:
// 404". Nothing if it may be the server's own.
std::optional<absl::Status> not_from_candelad(const std::string& address, const grpc::Status& status);

}  // namespace candela
