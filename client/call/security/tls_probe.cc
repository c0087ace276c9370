#include "client/call/security/tls_probe.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <memory>
#include <optional>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "server/base/net/address.h"

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

}  // namespace candela
