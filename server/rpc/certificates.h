// What a server shows to be believed, and whom it believes.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace candela {

// Names of PEM files.
struct CertificateFiles {
  std::string cert;       // the server's own, followed by those between it and its CA
  std::string key;        // the private key of the first one
  std::string client_ca;  // CAs of which clients must show a certificate; empty: clients need none
};

// PEM texts that fit together.
struct Certificates {
  std::string cert;
  std::string key;
  std::string client_ca;  // empty as above
  absl::Time expires;     // the server's own
  bool operator==(const Certificates&) const = default;
};

// Fails in a line that names the option, the file and the reason: as read_option_file, or with
// INVALID_ARGUMENT for a file that holds no PEM, damaged PEM or a key with a passphrase, and for a key of
// another certificate. One that has expired is no failure. No message holds a part of a key.
absl::StatusOr<Certificates> read_certificates(const CertificateFiles& files);

}  // namespace candela
