// The credentials of a channel, and what a server's TLS is like.
#pragma once

#include <grpcpp/security/credentials.h>
#include <grpcpp/support/channel_arguments.h>

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/security.h"

namespace candela {

// Finds out why TLS fails and says what to do. gRPC 1.51 reports only "certificate verify failed" or a closed
// connection.

// INVALID_ARGUMENT if the client certificate or its key cannot be used or the two do not match. The message
// says which.
absl::Status check_client_certificate(const std::string& cert_file, const std::string& key_file);

// Whether gRPC's message about a failed connection may be about TLS or the lack of it.
bool may_be_about_tls(absl::string_view message);

// Connects again to find the reason. Returns "" if TLS is not the reason or the address is not "HOST:PORT".
// Takes up to some seconds.
std::string why_tls_fails(const std::string& address, const ClientSecurity& security);

// The gRPC credentials of a channel to a server.

// `address` is "HOST:PORT" or "unix:PATH". Also sets what `arguments` need for them. Returns
// INVALID_ARGUMENT, with a line that says what to do, for unreadable files, a certificate without its key,
// and a token that would go over plain TCP beyond loopback.
absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> channel_credentials(
    const std::string& address, const ClientSecurity& security, grpc::ChannelArguments& arguments);

}  // namespace candela
