// Finds out why TLS fails and says what to do. gRPC 1.51 reports only "certificate verify failed" or a closed
// connection.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "client/security.h"

namespace candela {

// INVALID_ARGUMENT if the client certificate or its key cannot be used or the two do not match. The message
// says which.
absl::Status check_client_certificate(const std::string& cert_file, const std::string& key_file);

// Whether gRPC's message about a failed connection may be about TLS or the lack of it.
bool may_be_about_tls(absl::string_view message);

// Connects again to find the reason. Returns "" if TLS is not the reason or the address is not "HOST:PORT".
// Takes up to some seconds.
std::string why_tls_fails(const std::string& address, const ClientSecurity& security);

}  // namespace candela
