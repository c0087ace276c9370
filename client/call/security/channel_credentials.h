// The gRPC credentials of a channel to a server.
#pragma once

#include <grpcpp/security/credentials.h>
#include <grpcpp/support/channel_arguments.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "client/security.h"

namespace candela {

// `address` is "HOST:PORT" or "unix:PATH". Also sets what `arguments` need for them. Returns
// INVALID_ARGUMENT, with a line that says what to do, for unreadable files, a certificate without its key,
// and a token that would go over plain TCP beyond loopback.
absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> channel_credentials(
    const std::string& address, const ClientSecurity& security, grpc::ChannelArguments& arguments);

}  // namespace candela
