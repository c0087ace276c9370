// A certificate authority for one test.
#pragma once

#include <openssl/evp.h>
#include <openssl/x509.h>

#include <memory>
#include <string>

#include "absl/time/time.h"

namespace candela::testing {

struct Issued {
  std::string cert;  // PEM
  std::string key;   // PEM
};

class TestCa {
 public:
  explicit TestCa(const std::string& name);

  const std::string& cert() const { return cert_; }  // PEM
  // Issues a certificate for 127.0.0.1 and localhost. It expires after `life`, which may be negative.
  Issued issue(const std::string& name, absl::Duration life = absl::Hours(24),
               const std::string& names = "IP:127.0.0.1,DNS:localhost") const;

 private:
  using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;
  using Certificate = std::unique_ptr<X509, decltype(&X509_free)>;

  Key key_;
  Certificate own_;
  std::string cert_;
};

// The same key, encrypted with a passphrase.
std::string with_passphrase(const std::string& key);

}  // namespace candela::testing
