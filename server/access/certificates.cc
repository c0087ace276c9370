#include "server/access/certificates.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <ctime>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "server/base/option_file.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMaxCertificateFileBytes = 1 << 20;

constexpr char kCert[] = "tls-cert";
constexpr char kKey[] = "tls-key";
constexpr char kClientCa[] = "tls-client-ca";

using Bio = std::unique_ptr<BIO, decltype([](BIO* object) { BIO_free(object); })>;
using Certificate = std::unique_ptr<X509, decltype([](X509* object) { X509_free(object); })>;
using Key = std::unique_ptr<EVP_PKEY, decltype([](EVP_PKEY* object) { EVP_PKEY_free(object); })>;

Bio reader_of(const std::string& text) {
  return Bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
}

absl::Status unusable(const char* option, const std::string& path, const std::string& reason) {
  return absl::InvalidArgumentError(absl::StrFormat("%s: %s %s", option, path, reason));
}

// Returns at least one certificate.
absl::StatusOr<std::vector<Certificate>> parse_certificates(const char* option, const std::string& path,
                                                            const std::string& text) {
  std::vector<Certificate> certificates;
  const Bio bio = reader_of(text);
  ERR_clear_error();
  while (Certificate certificate{PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr)}) {
    certificates.push_back(std::move(certificate));
  }
  const bool at_end = ERR_GET_REASON(ERR_peek_last_error()) == PEM_R_NO_START_LINE;
  ERR_clear_error();
  if (!at_end) {
    return unusable(option, path,
                    absl::StrFormat("holds damaged PEM: certificate %d cannot be read; write the file again",
                                    certificates.size() + 1));
  }
  if (certificates.empty()) {
    return unusable(option, path,
                    "holds no PEM certificate; a certificate begins with -----BEGIN CERTIFICATE-----");
  }
  return certificates;
}

absl::StatusOr<Key> parse_key(const std::string& path, const std::string& text) {
  bool has_passphrase = false;
  const auto no_passphrase = [](char*, int, int, void* asked) {
    *static_cast<bool*>(asked) = true;
    return -1;
  };
  Key key(PEM_read_bio_PrivateKey(reader_of(text).get(), nullptr, no_passphrase, &has_passphrase));
  ERR_clear_error();
  if (key != nullptr) return key;
  if (has_passphrase) {
    return unusable(
        kKey, path,
        "has a passphrase, which a server cannot type in; remove it with: openssl pkey -in OLD -out NEW");
  }
  return unusable(kKey, path,
                  "holds no PEM private key that can be read; a key begins with -----BEGIN PRIVATE KEY-----");
}

absl::Time time_of(const ASN1_TIME* time) {
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return absl::InfiniteFuture();
  return absl::FromTM(parts, absl::UTCTimeZone());
}

}  // namespace

absl::StatusOr<Certificates> read_certificates(const CertificateFiles& files) {
  ASSIGN_OR_RETURN(std::string cert,
                   read_option_file(kCert, files.cert, kMaxCertificateFileBytes, Secrecy::kPublic));
  absl::StatusOr<std::string> key =
      read_option_file(kKey, files.key, kMaxCertificateFileBytes, Secrecy::kSecret);
  if (!key.ok()) return key.status();
  ASSIGN_OR_RETURN(const std::vector<Certificate> chain, parse_certificates(kCert, files.cert, cert));
  ASSIGN_OR_RETURN(const Key parsed, parse_key(files.key, *key));
  X509* own = chain.front().get();
  if (X509_check_private_key(own, parsed.get()) != 1) {
    ERR_clear_error();
    return unusable(
        kKey, files.key,
        absl::StrFormat(
            "is not the key of the first certificate in %s; use a key and a certificate that belong "
            "together, with the server's own certificate first",
            files.cert));
  }
  Certificates certificates{std::move(cert), *std::move(key), "", time_of(X509_get0_notAfter(own))};
  if (files.client_ca.empty()) return certificates;
  ASSIGN_OR_RETURN(certificates.client_ca,
                   read_option_file(kClientCa, files.client_ca, kMaxCertificateFileBytes, Secrecy::kPublic));
  RETURN_IF_ERROR(parse_certificates(kClientCa, files.client_ca, certificates.client_ca).status());
  return certificates;
}

}  // namespace candela
