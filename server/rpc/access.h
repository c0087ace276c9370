// Who may connect to a server and call it: TLS, client certificates and bearer tokens, from files that are
// read again when they change.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "server/base/file_watch.h"
#include "server/base/metrics.h"
#include "server/rpc/bearer_tokens.h"
#include "server/rpc/certificates.h"

namespace candela {

// Any thread. A new file that cannot be used is logged as an error, and what was read before stays in force.
// Connections keep the certificates that they began with; tokens are looked at with every call.
class Access {
 public:
  // Empty `certificates.cert`: plain TCP. Empty `token_file`: no token is asked for. Fails as
  // read_certificates and BearerTokens::read.
  static absl::StatusOr<std::unique_ptr<Access>> open(const CertificateFiles& certificates,
                                                      const std::string& token_file);
  ~Access();

  // For a listening address: TLS for TCP where there are certificates, none for "unix:PATH". Every method but
  // the standard health service's asks for a token where there are any; those that have none are counted in
  // `metrics`. For one address of one server, which this outlives, as `metrics` does.
  std::shared_ptr<grpc::ServerCredentials> credentials(const std::string& address, Metrics& metrics);

 private:
  class Port;

  Access(CertificateFiles files, std::string token_file);
  bool tls() const { return !files_.cert.empty(); }
  absl::Status read();
  void read_again();
  std::shared_ptr<const Certificates> certificates() const;
  bool allow(absl::string_view path, absl::string_view authorization) const;

  const CertificateFiles files_;
  const std::string token_file_;
  mutable absl::Mutex mutex_;
  std::shared_ptr<const Certificates> certificates_ ABSL_GUARDED_BY(mutex_);
  std::shared_ptr<const BearerTokens> tokens_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::shared_ptr<Port>> ports_;  // gRPC keeps no more than pointers to them
  std::optional<FileWatch> watch_;            // last: its thread uses all of the above
};

}  // namespace candela
