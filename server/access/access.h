// Access control: certificates, bearer tokens, and the log of refusals.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/base/clock.h"
#include "server/base/file_watch.h"
#include "server/base/metrics.h"

namespace candela {

// The log of calls that were refused for their token. Only the log tells a missing token from an unknown one:
// the answer to the client is the same, so that it does not help to guess tokens.

enum class Refusal { kNoToken, kUnknownToken };

// Writes at most one line a second for each reason, however many calls a stranger makes. It names the client
// of the last of them. Any thread.
class RefusalLog {
 public:
  // `clock` outlives it.
  explicit RefusalLog(Clock& clock) : clock_(clock) {}

  // `peer` is called only if there is a line.
  void add(Refusal refusal, absl::FunctionRef<std::string()> peer);

 private:
  Clock& clock_;
  absl::Mutex mutex_;
  std::array<OneASecond, 2> reasons_ ABSL_GUARDED_BY(mutex_);
};

// The bearer tokens that allow their holders to call a server.

inline constexpr size_t kMinBearerBytes = 16;
inline constexpr size_t kMaxBearerTokens = 64;

// Keeps only the SHA-256 of each token. Any thread.
class BearerTokens {
 public:
  // Reads one token per line, each of kMinBearerBytes or more visible ASCII characters. Empty lines and lines
  // that begin with # are skipped. All tokens are valid, so one can be replaced without an interruption.
  // Fails as read_option_file does for the option token-file, and with INVALID_ARGUMENT and the line number.
  // No message contains a part of a token.
  static absl::StatusOr<BearerTokens> read(const std::string& path);

  // Whether the value of the "authorization" metadata is "Bearer TOKEN" with one of the tokens. The time that
  // it takes does not depend on which token matches.
  bool allow(absl::string_view authorization) const;

  bool operator==(const BearerTokens&) const = default;

 private:
  using Digest = std::array<unsigned char, 32>;
  std::vector<Digest> digests_;
};

// A server's TLS certificates and key, read from PEM files.

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

// Access control: TLS, client certificates and bearer tokens, from files that are read again when they
// change.
//
// If a changed file cannot be used, that is logged as an error and the earlier contents stay in force. A
// connection keeps the certificates that it began with; tokens are checked for every call. Any thread.
class Access {
 public:
  // If `certificates.cert` is empty, connections are plain TCP. If `token_file` is empty, calls need no
  // token. Fails as read_certificates and BearerTokens::read do. `clock` outlives it.
  static absl::StatusOr<std::unique_ptr<Access>> open(const CertificateFiles& certificates,
                                                      const std::string& token_file, Clock& clock);
  ~Access();

  // The credentials for one listening address of one server: TLS for TCP if there are certificates, and no
  // TLS for "unix:PATH". If there are tokens, every method needs one, except those of the standard health
  // service. `metrics` counts calls without a valid token, and the log says whether they had one and who sent
  // them. gRPC does not say here who calls over TCP, so `clients` tells whose connections are open there; on
  // a unix: socket it is not called. This object and `metrics` outlive the server.
  std::shared_ptr<grpc::ServerCredentials> credentials(const std::string& address, Metrics& metrics,
                                                       std::function<std::set<std::string>()> clients);

  // When the certificate that new connections get expires; absent without TLS.
  std::optional<absl::Time> certificate_expires() const;

 private:
  class Port;

  Access(CertificateFiles files, std::string token_file, Clock& clock);
  bool tls() const { return !files_.cert.empty(); }
  absl::Status read();
  void read_again();
  std::shared_ptr<const Certificates> certificates() const;
  bool allow(absl::string_view path, absl::string_view authorization) const;

  const CertificateFiles files_;
  const std::string token_file_;
  Clock& clock_;
  mutable absl::Mutex mutex_;
  std::shared_ptr<const Certificates> certificates_ ABSL_GUARDED_BY(mutex_);
  std::shared_ptr<const BearerTokens> tokens_ ABSL_GUARDED_BY(mutex_);
  RefusalLog refusals_;
  std::vector<std::shared_ptr<Port>> ports_;  // gRPC keeps only pointers to them
  std::optional<FileWatch> watch_;            // last, because its thread uses all of the above
};

}  // namespace candela
