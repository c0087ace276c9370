// Access control: TLS, client certificates and bearer tokens, from files that are read again when they
// change.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/access/bearer_tokens.h"
#include "server/access/certificates.h"
#include "server/access/refusal_log.h"
#include "server/base/clock.h"
#include "server/base/file_watch.h"
#include "server/base/metrics.h"

namespace candela {

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
