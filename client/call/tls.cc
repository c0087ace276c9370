#include "client/call/tls.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/synchronization/mutex.h"
#include "client/base/plain_file.h"
#include "server/base/address.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr int kPatienceSeconds = 2;  // for connecting and for each answer

using Bio = std::unique_ptr<BIO, decltype([](BIO* object) { BIO_free_all(object); })>;
using Context = std::unique_ptr<SSL_CTX, decltype([](SSL_CTX* object) { SSL_CTX_free(object); })>;
using Ssl = std::unique_ptr<SSL, decltype([](SSL* object) { SSL_free(object); })>;

// Null if nothing listens.
Bio connect_to(const std::string& address) {
  Bio bio(BIO_new_connect(address.c_str()));
  if (bio == nullptr || BIO_do_connect_retry(bio.get(), kPatienceSeconds, 20) != 1) return nullptr;
  int socket = -1;
  BIO_get_fd(bio.get(), &socket);
  BIO_socket_nbio(socket, 0);
  const timeval patience{kPatienceSeconds, 0};
  setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  setsockopt(socket, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
  return bio;
}

Context context_for(const ClientSecurity& security) {
  Context context(SSL_CTX_new(TLS_client_method()));
  SSL_CTX_set_min_proto_version(context.get(), TLS1_2_VERSION);
  if (!security.wants_tls()) return context;
  SSL_CTX_set_verify(context.get(), SSL_VERIFY_PEER, nullptr);
  if (security.ca_file.empty()) {
    SSL_CTX_set_default_verify_paths(context.get());
  } else {
    SSL_CTX_load_verify_locations(context.get(), security.ca_file.c_str(), nullptr);
  }
  if (!security.cert_file.empty()) {
    SSL_CTX_use_certificate_chain_file(context.get(), security.cert_file.c_str());
    SSL_CTX_use_PrivateKey_file(context.get(), security.key_file.c_str(), SSL_FILETYPE_PEM);
  }
  return context;
}

// The problem with the server's certificate, which should be for `host`.
std::string about_certificate(long result, const std::string& address, const std::string& host,
                              const ClientSecurity& security) {
  switch (result) {
    case X509_V_ERR_CERT_HAS_EXPIRED:
      return absl::StrFormat("the certificate of %s has expired; the server's operator must renew it",
                             address);
    case X509_V_ERR_CERT_NOT_YET_VALID:
      return absl::StrFormat("the certificate of %s is not valid yet; check the clocks of both machines",
                             address);
    case X509_V_ERR_HOSTNAME_MISMATCH:
    case X509_V_ERR_IP_ADDRESS_MISMATCH:
      return absl::StrFormat(
          "the certificate of %s is not for the name %s; connect "
          "by a name that it is for, or give that as --tls-name",
          address, host);
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
    case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
    case X509_V_ERR_CERT_SIGNATURE_FAILURE:
    case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
    case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
      return absl::StrFormat(
          "the certificate of %s is not signed by a CA of %s; give the one that signed it with --tls-ca",
          address, security.ca_file.empty() ? "this system" : security.ca_file);
    default:
      return absl::StrFormat(
          "the certificate of %s cannot be trusted (%s); the server's operator must replace it", address,
          X509_verify_cert_error_string(result));
  }
}

// The problem with a server that asked for a certificate and closed the connection. gRPC says no more.
std::string about_refusal(SSL* ssl, const std::string& address, const ClientSecurity& security) {
  const X509* own = SSL_get_certificate(ssl);
  if (own == nullptr) {
    return absl::StrFormat("%s asks for a client certificate; give one with --tls-cert and --tls-key",
                           address);
  }
  if (X509_cmp_current_time(X509_get0_notAfter(own)) < 0) {
    return absl::StrFormat("%s refuses the client certificate %s, which has expired; give one that is valid",
                           address, security.cert_file);
  }
  return absl::StrFormat(
      "%s refuses the client certificate %s; give one that a CA of the server's --tls-client-ca has signed",
      address, security.cert_file);
}

}  // namespace

absl::Status check_client_certificate(const std::string& cert_file, const std::string& key_file) {
  const Context context(SSL_CTX_new(TLS_client_method()));
  // Never asks for a passphrase.
  SSL_CTX_set_default_passwd_cb(context.get(), [](char*, int, int, void*) { return -1; });
  const bool cert = SSL_CTX_use_certificate_chain_file(context.get(), cert_file.c_str()) == 1;
  const bool pair =
      cert && SSL_CTX_use_PrivateKey_file(context.get(), key_file.c_str(), SSL_FILETYPE_PEM) == 1;
  ERR_clear_error();
  if (pair) return absl::OkStatus();
  if (!cert) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "the client certificate %s has no readable PEM certificate; name another file", cert_file));
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s has no PEM private key of the client certificate %s; give the two that belong together", key_file,
      cert_file));
}

bool may_be_about_tls(absl::string_view message) {
  for (const char* sign :
       {"andshake", "SSL", "eer name", "orrupted frame", "ocket closed", "onnection reset"}) {
    if (absl::StrContains(message, sign)) return true;
  }
  return false;
}

std::string why_tls_fails(const std::string& address, const ClientSecurity& security) {
  const std::optional<HostPort> at = parse_host_port(address);
  if (!at) return "";
  const Bio connection = connect_to(address);
  if (connection == nullptr) return "";
  const Context context = context_for(security);
  bool asked = false;  // for the client's certificate
  const auto note = [](SSL*, void* was_asked) {
    *static_cast<bool*>(was_asked) = true;
    return 1;
  };
  SSL_CTX_set_cert_cb(context.get(), note, &asked);
  const Ssl ssl(SSL_new(context.get()));
  const std::string host = security.server_name.empty() ? std::string(at->host) : security.server_name;
  if (X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(ssl.get()), host.c_str()) != 1) {
    SSL_set_tlsext_host_name(ssl.get(), host.c_str());
    SSL_set1_host(ssl.get(), host.c_str());
  }
  static constexpr unsigned char kHttp2[] = {2, 'h', '2'};
  SSL_set_alpn_protos(ssl.get(), kHttp2, sizeof kHttp2);
  BIO_up_ref(connection.get());
  SSL_set_bio(ssl.get(), connection.get(), connection.get());
  ERR_clear_error();
  bool well = SSL_connect(ssl.get()) == 1;
  const bool spoke_tls = well || SSL_get0_peer_certificate(ssl.get()) != nullptr;
  if (!security.wants_tls()) {
    ERR_clear_error();
    if (!spoke_tls) return "";
    return absl::StrFormat(
        "%s speaks TLS and the client did not; give --tls, or --tls-ca with the CA of its certificate",
        address);
  }
  // In TLS 1.3 a server that refuses the client's certificate closes only now. Any other server sends
  // something first.
  char byte = 0;
  if (well) well = SSL_read(ssl.get(), &byte, 1) == 1;
  const int reason = ERR_GET_REASON(ERR_peek_last_error());
  ERR_clear_error();
  if (well) return "";
  if (const long result = SSL_get_verify_result(ssl.get()); result != X509_V_OK) {
    return about_certificate(result, address, host, security);
  }
  if (asked) return about_refusal(ssl.get(), address, security);
  if (!spoke_tls && reason == SSL_R_WRONG_VERSION_NUMBER) {
    return absl::StrFormat(
        "%s does not speak TLS; leave out --tls and the other "
        "--tls options, or start candelad with --tls-cert",
        address);
  }
  return "";
}

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
