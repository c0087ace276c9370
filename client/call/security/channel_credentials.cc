#include "client/call/security/channel_credentials.h"

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/synchronization/mutex.h"
#include "client/call/security/plain_file.h"
#include "client/call/security/tls_probe.h"
#include "server/base/net/address.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMaxBytes = size_t{1} << 20;  // of a certificate or a token

bool stays_here(const std::string& address) {
  const std::optional<HostPort> at = parse_host_port(address);
  return is_unix_address(address) || (at && is_loopback(at->host));
}

absl::StatusOr<std::string> read_file(const char* what, const std::string& path) {
  absl::StatusOr<std::string> text = read_plain_file(path, kMaxBytes);
  if (text.ok() && !text->empty()) return text;
  return absl::InvalidArgumentError(
      absl::StrFormat("cannot read the %s %s: %s; name a file that this user may read", what, path,
                      text.ok() ? "it is empty" : text.status().message()));
}

absl::StatusOr<std::string> read_pem(const char* what, const char* begin, const std::string& path) {
  absl::StatusOr<std::string> text = read_file(what, path);
  if (!text.ok() || absl::StrContains(*text, begin)) return text;
  return absl::InvalidArgumentError(absl::StrFormat(
      "the %s %s is not PEM, because no line begins with %s; name another file", what, path, begin));
}

absl::StatusOr<std::string> read_token(const std::string& path) {
  const absl::StatusOr<std::string> text = read_file("token file", path);
  if (!text.ok()) return text;
  for (const absl::string_view line : absl::StrSplit(*text, '\n')) {
    const std::string token(absl::StripAsciiWhitespace(line));
    if (token.empty() || token[0] == '#') continue;
    if (std::all_of(token.begin(), token.end(), absl::ascii_isgraph)) return token;
    return absl::InvalidArgumentError(absl::StrFormat(
        "the token in %s holds a space or a character that is not visible ASCII; write a new one", path));
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("the token file %s holds no token; write one into it", path));
}

// Adds the token to each call.
class TokenPlugin final : public grpc::MetadataCredentialsPlugin {
 public:
  TokenPlugin(std::string path, std::string token) : path_(std::move(path)), token_(std::move(token)) {}

  bool IsBlocking() const override { return false; }  // a small file
  const char* GetType() const override { return "candela"; }
  grpc::string DebugString() override { return "candela's bearer token"; }

  grpc::Status GetMetadata(grpc::string_ref, grpc::string_ref, const grpc::AuthContext&,
                           std::multimap<grpc::string, grpc::string>* metadata) override {
    absl::StatusOr<std::string> read = read_token(path_);
    const absl::MutexLock lock(&mutex_);
    if (read.ok()) token_ = *std::move(read);
    metadata->emplace("authorization", absl::StrCat("Bearer ", token_));
    return grpc::Status::OK;
  }

 private:
  const std::string path_;
  absl::Mutex mutex_;
  std::string token_ ABSL_GUARDED_BY(mutex_);
};

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> tls_credentials(const ClientSecurity& security) {
  if (security.cert_file.empty() != security.key_file.empty()) {
    return absl::InvalidArgumentError(
        "a client certificate needs its key: give both --tls-cert and --tls-key");
  }
  grpc::SslCredentialsOptions options;
  const auto read = [](const char* what, const char* begin, const std::string& path, std::string& into) {
    if (path.empty()) return absl::OkStatus();
    absl::StatusOr<std::string> text = read_pem(what, begin, path);
    if (text.ok()) into = *std::move(text);
    return text.status();
  };
  absl::Status status =
      read("CA file", "-----BEGIN CERTIFICATE-----", security.ca_file, options.pem_root_certs);
  status.Update(
      read("client certificate", "-----BEGIN CERTIFICATE-----", security.cert_file, options.pem_cert_chain));
  status.Update(read("client key", "-----BEGIN ", security.key_file, options.pem_private_key));
  if (!security.cert_file.empty()) {
    status.Update(check_client_certificate(security.cert_file, security.key_file));
  }
  if (!status.ok()) return status;
  return grpc::SslCredentials(options);
}

}  // namespace

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> channel_credentials(
    const std::string& address, const ClientSecurity& security, grpc::ChannelArguments& arguments) {
  const bool is_unix = is_unix_address(address);
  const bool tls = security.wants_tls() && !is_unix;
  std::shared_ptr<grpc::ChannelCredentials> channel = grpc::InsecureChannelCredentials();
  if (tls) {
    ASSIGN_OR_RETURN(channel, tls_credentials(security));
    if (!security.server_name.empty()) arguments.SetSslTargetNameOverride(security.server_name);
  } else if (!security.key_file.empty() && !is_unix) {
    return absl::InvalidArgumentError(
        "a client key needs its certificate: give both --tls-cert and --tls-key");
  }
  if (security.token_file.empty()) return channel;

  if (!tls && !stays_here(address)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "a token is not sent to %s in the clear, where anyone on the way could read it; add --tls or "
        "--tls-ca, or leave the token out",
        address));
  }
  ASSIGN_OR_RETURN(std::string token, read_token(security.token_file));
  auto plugin = std::make_unique<TokenPlugin>(security.token_file, std::move(token));
  if (tls) {
    return grpc::CompositeChannelCredentials(channel, grpc::MetadataCredentialsFromPlugin(std::move(plugin)));
  }
  // Without TLS. gRPC checks that the other end of the connection is local before it sends a call.
  return grpc::CompositeChannelCredentials(
      grpc::experimental::LocalCredentials(is_unix ? UDS : LOCAL_TCP),
      grpc::experimental::MetadataCredentialsFromPlugin(std::move(plugin), GRPC_SECURITY_NONE));
}

}  // namespace candela
