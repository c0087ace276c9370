// Why TLS fails, in words that say what to do: gRPC 1.51 knows no more than "certificate verify failed", or
// that the connection was closed.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "client/security.h"

namespace candela {

// INVALID_ARGUMENT, saying which, for a client certificate or a key that cannot be used, or that are no pair.
absl::Status check_client_certificate(const std::string& cert_file, const std::string& key_file);

// Whether gRPC's words about a connection that did not come about may have to do with TLS or the lack of it.
bool may_be_about_tls(absl::string_view message);

// Found out by another try. Empty where TLS is not the reason, and for an address that is not "HOST:PORT".
// Takes some seconds at most.
std::string why_tls_fails(const std::string& address, const ClientSecurity& security);

}  // namespace candela
