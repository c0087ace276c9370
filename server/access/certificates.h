// A server's TLS certificates and key, read from PEM files.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace candela {

// Paths of PEM files.
struct CertificateFiles {
  std::string cert;       // the server's certificate, followed by its intermediate certificates
  std::string key;        // the private key of the first certificate
  std::string client_ca;  // CAs that must have signed a client's certificate; empty: clients need none
};

// The texts of PEM files that belong together.
struct Certificates {
  std::string cert;
  std::string key;
  std::string client_ca;  // may be empty, as above
  absl::Time expires;     // when the server's certificate expires
  bool operator==(const Certificates&) const = default;
};

// Fails with one line that names the option, the file and the reason: as read_option_file does, or with
// INVALID_ARGUMENT if a file holds no PEM, damaged PEM or a key with a passphrase, or if the key belongs to
// another certificate. An expired certificate is not an error. No message contains a part of a key.
absl::StatusOr<Certificates> read_certificates(const CertificateFiles& files);

}  // namespace candela
