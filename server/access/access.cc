#include "server/access/access.h"

#include <grpc/grpc.h>
#include <grpc/grpc_security.h>
#include <grpc/slice.h>
#include <openssl/crypto.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/sha.h>
#include <openssl/x509.h>

#include <algorithm>
#include <ctime>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "server/access/client_identity.h"
#include "server/base/address.h"
#include "server/base/log.h"
#include "server/base/option_file.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

const char* word(Refusal refusal) { return refusal == Refusal::kNoToken ? "no token" : "unknown token"; }

}  // namespace

void RefusalLog::add(Refusal refusal, absl::FunctionRef<std::string()> peer) {
  std::optional<uint64_t> calls;
  {
    const absl::MutexLock lock(&mutex_);
    calls = reasons_[static_cast<size_t>(refusal)].pass(clock_.now());
  }
  if (!calls) return;
  log_event(LogLevel::kWarning, "call refused",
            {{"reason", word(refusal)}, {"peer", peer()}, {"calls", *calls}});
}

namespace {

constexpr size_t kMaxTokenFileBytes = 64 << 10;
constexpr absl::string_view kScheme = "Bearer ";
constexpr char kMakeOne[] = "openssl rand -hex 32";

std::array<unsigned char, SHA256_DIGEST_LENGTH> digest_of(absl::string_view token) {
  std::array<unsigned char, SHA256_DIGEST_LENGTH> digest;
  SHA256(reinterpret_cast<const unsigned char*>(token.data()), token.size(), digest.data());
  return digest;
}

}  // namespace

absl::StatusOr<BearerTokens> BearerTokens::read(const std::string& path) {
  ASSIGN_OR_RETURN(const std::string text,
                   read_option_file("token-file", path, kMaxTokenFileBytes, Secrecy::kSecret));
  BearerTokens tokens;
  int number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() || line[0] == '#') continue;
    if (line.size() < kMinBearerBytes) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "token-file: line %d of %s has %d characters and a token has at least %d; make one with: %s",
          number, path, line.size(), kMinBearerBytes, kMakeOne));
    }
    if (!std::all_of(line.begin(), line.end(), absl::ascii_isgraph)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("token-file: line %d of %s holds a space or a character that is not visible ASCII; "
                          "make a token with: %s",
                          number, path, kMakeOne));
    }
    if (tokens.digests_.size() == kMaxBearerTokens) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "token-file: %s holds more than %d tokens; remove the unused ones", path, kMaxBearerTokens));
    }
    tokens.digests_.push_back(digest_of(line));
  }
  if (tokens.digests_.empty()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("token-file: %s holds no token; make one with: %s", path, kMakeOne));
  }
  return tokens;
}

bool BearerTokens::allow(absl::string_view authorization) const {
  const absl::string_view scheme = authorization.substr(0, kScheme.size());
  if (!absl::EqualsIgnoreCase(scheme, kScheme)) return false;
  const Digest digest = digest_of(authorization.substr(kScheme.size()));
  bool found = false;
  for (const Digest& known : digests_) {
    found |= CRYPTO_memcmp(known.data(), digest.data(), digest.size()) == 0;
  }
  return found;
}

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

namespace {

constexpr absl::string_view kOpenToAll = "/grpc.health.v1.Health/";

// The answer for a missing token and for an unknown one.
constexpr char kWhatToDo[] =
    "this server requires a token: send the metadata authorization: Bearer TOKEN, or pass --token-file FILE "
    "to candela; ask the operator of the server for a token";

// One of these, in words.
std::string one_of(const std::set<std::string>& clients) {
  constexpr size_t kNamed = 4;
  if (clients.empty()) return "unknown";  // it has gone meanwhile
  if (clients.size() == 1) return *clients.begin();
  const auto end = std::next(clients.begin(), static_cast<ptrdiff_t>(std::min(clients.size(), kNamed)));
  std::string words = absl::StrCat("one of ", absl::StrJoin(clients.begin(), end, ", "));
  if (clients.size() > kNamed) absl::StrAppend(&words, " and ", clients.size() - kNamed, " more");
  return words;
}

absl::string_view view_of(const grpc_slice& slice) {
  return {reinterpret_cast<const char*>(GRPC_SLICE_START_PTR(slice)), GRPC_SLICE_LENGTH(slice)};
}

}  // namespace

// The credentials of one listening address. gRPC's C++ classes either do not reload certificates, or drop the
// old ones if the new ones are damaged (TlsServerCredentials of 1.51). The C interface asks before each
// handshake and keeps what it has.
class Access::Port final : public grpc::ServerCredentials {
 public:
  Port(Access& access, Metrics& metrics, const std::string& address,
       std::function<std::set<std::string>()> clients)
      : access_(access), metrics_(metrics), local_(is_unix_address(address)), clients_(std::move(clients)) {
    if (access.tls() && !local_) {
      const auto request = access.files_.client_ca.empty()
                               ? GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE
                               : GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY;
      credentials_ = grpc_ssl_server_credentials_create_with_options(
          grpc_ssl_server_credentials_create_options_using_config_fetcher(request, fetch, this));
    } else {
      credentials_ = grpc_insecure_server_credentials_create();
    }
    if (access.token_file_.empty()) return;
    grpc_server_credentials_set_auth_metadata_processor(credentials_, {check_token, [](void*) {}, this});
  }
  ~Port() override { grpc_server_credentials_release(credentials_); }

  // gRPC never calls this itself.
  void SetAuthMetadataProcessor(const std::shared_ptr<grpc::AuthMetadataProcessor>&) override {}

 private:
  int AddPortToServer(const std::string& address, grpc_server* server) override {
    return grpc_server_add_http2_port(server, address.c_str(), credentials_);
  }

  // gRPC calls this under a lock of the port.
  static grpc_ssl_certificate_config_reload_status fetch(void* self,
                                                         grpc_ssl_server_certificate_config** config) {
    Port& port = *static_cast<Port*>(self);
    std::shared_ptr<const Certificates> now = port.access_.certificates();
    if (now == port.fetched_) return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_UNCHANGED;
    const grpc_ssl_pem_key_cert_pair own{now->key.c_str(), now->cert.c_str()};
    // Debian's gRPC requires a CA even if clients need no certificate. Any CA works then.
    const std::string& client_ca = now->client_ca.empty() ? now->cert : now->client_ca;
    *config = grpc_ssl_server_certificate_config_create(client_ca.c_str(), &own, 1);
    port.fetched_ = std::move(now);
    return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_NEW;
  }

  static void check_token(void* self, grpc_auth_context*, const grpc_metadata* metadata, size_t count,
                          grpc_process_auth_metadata_done_cb done, void* call) {
    Port& port = *static_cast<Port*>(self);
    absl::string_view path;
    absl::string_view forwarded_for;
    const grpc_metadata* authorization = nullptr;
    for (size_t i = 0; i < count; ++i) {
      if (view_of(metadata[i].key) == ":path") path = view_of(metadata[i].value);
      if (view_of(metadata[i].key) == "x-forwarded-for") forwarded_for = view_of(metadata[i].value);
      if (view_of(metadata[i].key) == "authorization") authorization = &metadata[i];
    }
    const absl::string_view shown = authorization == nullptr ? "" : view_of(authorization->value);
    if (port.access_.allow(path, shown)) {
      // The token stays in the metadata, because it is a part of who the client is (client_identity.h).
      done(call, nullptr, 0, nullptr, 0, GRPC_STATUS_OK, nullptr);
    } else {
      port.metrics_.rejected(Rejection::kAccess);
      port.access_.refusals_.add(shown.empty() ? Refusal::kNoToken : Refusal::kUnknownToken,
                                 [&] { return port.peer(forwarded_for); });
      done(call, nullptr, 0, nullptr, 0, GRPC_STATUS_UNAUTHENTICATED, kWhatToDo);
    }
  }

  std::string peer(absl::string_view forwarded_for) const {
    return local_ ? client_address("unix:", forwarded_for) : one_of(clients_());
  }

  Access& access_;
  Metrics& metrics_;
  const bool local_;  // a unix: socket
  const std::function<std::set<std::string>()> clients_;
  grpc_server_credentials* credentials_ = nullptr;
  std::shared_ptr<const Certificates> fetched_;
};

absl::StatusOr<std::unique_ptr<Access>> Access::open(const CertificateFiles& certificates,
                                                     const std::string& token_file, Clock& clock) {
  std::unique_ptr<Access> access(new Access(certificates, token_file, clock));
  RETURN_IF_ERROR(access->read());
  std::vector<std::string> paths;
  for (const std::string& path : {certificates.cert, certificates.key, certificates.client_ca, token_file}) {
    if (!path.empty()) paths.push_back(path);
  }
  if (!paths.empty()) access->watch_.emplace(paths, clock, [a = access.get()] { a->read_again(); });
  return access;
}

Access::Access(CertificateFiles files, std::string token_file, Clock& clock)
    : files_(std::move(files)), token_file_(std::move(token_file)), clock_(clock), refusals_(clock) {}

Access::~Access() = default;

// Certificates and tokens are independent: if one of them cannot be used, the other is still updated.
absl::Status Access::read() {
  absl::Status status;
  if (tls()) {
    absl::StatusOr<Certificates> read = read_certificates(files_);
    const std::shared_ptr<const Certificates> before = certificates();
    if (read.ok() && (before == nullptr || *before != *read)) {
      const bool expired = read->expires < clock_.now();
      log_event(expired ? LogLevel::kError : LogLevel::kInfo,
                expired ? "the certificate has expired: no client will take it" : "certificates read",
                {{"file", files_.cert}, {"expires", absl::FormatTime(read->expires, absl::UTCTimeZone())}});
      absl::MutexLock lock(&mutex_);
      certificates_ = std::make_shared<const Certificates>(*std::move(read));
    } else {
      status.Update(read.status());
    }
  }
  if (!token_file_.empty()) {
    absl::StatusOr<BearerTokens> read = BearerTokens::read(token_file_);
    absl::MutexLock lock(&mutex_);
    if (read.ok() && (tokens_ == nullptr || *tokens_ != *read)) {
      log_event(LogLevel::kInfo, "tokens read", {{"file", token_file_}});
      tokens_ = std::make_shared<const BearerTokens>(*std::move(read));
    } else {
      status.Update(read.status());
    }
  }
  return status;
}

void Access::read_again() {
  const absl::Status status = read();
  if (status.ok()) return;
  log_event(LogLevel::kError, "a new file cannot be used; what was read before stays in force",
            {{"because", status.message()}});
}

std::shared_ptr<grpc::ServerCredentials> Access::credentials(const std::string& address, Metrics& metrics,
                                                             std::function<std::set<std::string>()> clients) {
  const bool with_tls = tls() && !is_unix_address(address);
  if (!with_tls && token_file_.empty()) return grpc::InsecureServerCredentials();
  return ports_.emplace_back(std::make_shared<Port>(*this, metrics, address, std::move(clients)));
}

std::shared_ptr<const Certificates> Access::certificates() const {
  absl::MutexLock lock(&mutex_);
  return certificates_;
}

std::optional<absl::Time> Access::certificate_expires() const {
  const std::shared_ptr<const Certificates> now = certificates();
  return now == nullptr ? std::nullopt : std::optional(now->expires);
}

bool Access::allow(absl::string_view path, absl::string_view authorization) const {
  if (absl::StartsWith(path, kOpenToAll)) return true;
  std::shared_ptr<const BearerTokens> tokens;
  {
    absl::MutexLock lock(&mutex_);
    tokens = tokens_;
  }
  return tokens->allow(authorization);
}

}  // namespace candela
