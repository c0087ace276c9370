// TLS, tokens, and files of certificates that are replaced while a server runs.
#include <arpa/inet.h>
#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <openssl/ssl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/call/raw_call.h"
#include "client/connection.h"
#include "client/session.h"
#include "server/server.h"
#include "tests/service/clients.h"
#include "tests/service/real_time.h"
#include "tests/service/service_fixture.h"
#include "tests/service/test_ca.h"
#include "tests/support/daemon.h"
#include "tests/support/device_fixture.h"
#include "tests/support/files.h"
#include "tests/support/scenes.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr char kToken[] = "0123456789abcdef-one";
constexpr char kOtherToken[] = "0123456789abcdef-two";

class SecurityTest : public ::testing::Test {
 protected:
  // Replaces the file atomically, as a careful rotation does. Only its owner may read it.
  std::string put(const std::string& name, const std::string& text) {
    const std::string path = folder_.path(name);
    write_file(path + ".new", text);
    EXPECT_EQ(chmod((path + ".new").c_str(), S_IRUSR | S_IWUSR), 0);
    EXPECT_EQ(std::rename((path + ".new").c_str(), path.c_str()), 0);
    return path;
  }
  void put(const std::string& name, const Issued& issued) {
    put(name + ".key", issued.key);
    put(name + ".pem", issued.cert);
  }

  void SetUp() override {
    put("ca.pem", ca_.cert());
    put("other_ca.pem", other_ca_.cert());
    put("server", ca_.issue("server"));
    put("client", ca_.issue("client"));
    put("tokens", std::string("# in use\n") + kToken + "\n");
    put("token", std::string(kToken) + "\n");
    put("other_token", std::string(kOtherToken) + "\n");
  }

  std::vector<std::string> tls(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{"--listen",   "127.0.0.1:0",
                                       "--tls-cert", folder_.path("server.pem"),
                                       "--tls-key",  folder_.path("server.key")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  ClientSecurity trusting(const std::string& ca = "ca.pem") const { return {.ca_file = folder_.path(ca)}; }
  ClientSecurity showing(const std::string& name) const {
    ClientSecurity security = trusting();
    security.cert_file = folder_.path(name + ".pem");
    security.key_file = folder_.path(name + ".key");
    return security;
  }

  static absl::Status render(const std::string& address, const ClientSecurity& security) {
    const absl::StatusOr<Connection> connection = Connection::open(address, security);
    return connection.ok() ? render(*connection) : connection.status();
  }
  static absl::Status render(const Connection& connection) {
    const WireFrame frame = natural(16, 8);
    return connection
        .render({},
                {frame.desc.width, frame.desc.height, static_cast<v1::PixelFormat>(frame.desc.format),
                 frame.pixels},
                absl::Now() + absl::Seconds(60))
        .status();
  }

  // Waits some seconds for the condition; returns whether it became true.
  template <typename Condition>
  static bool soon(const Condition& condition) {
    for (int i = 0; i < 200; ++i) {
      if (condition()) return true;
      absl::SleepFor(absl::Milliseconds(50));
    }
    return false;
  }

  const TestCa ca_{"Candela test CA"};
  const TestCa other_ca_{"Another CA"};
  TemporaryFolder folder_;
};

// Expects a one-line status with this code and these words.
void expect_says(const absl::Status& status, absl::StatusCode code, const std::string& words) {
  EXPECT_EQ(status.code(), code) << status;
  EXPECT_TRUE(says(status.message(), words));
  EXPECT_EQ(std::string(status.message()).find('\n'), std::string::npos) << status;
}

// TLS, client certificates and bearer tokens, between a real candelad and the client library.

constexpr auto kUnavailable = absl::StatusCode::kUnavailable;
constexpr auto kUnauthenticated = absl::StatusCode::kUnauthenticated;
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

using Tls = SecurityTest;
using Mtls = SecurityTest;
using Tokens = SecurityTest;
using SecurityFiles = SecurityTest;

TEST_F(Tls, ServesThoseWhoTrustItsCa) {
  Daemon daemon(tls());
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  EXPECT_OK(render(address, trusting()));
  EXPECT_OK(Connection::open(address, trusting())->health());
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(), 0) << daemon.errors();
}

TEST_F(Tls, SaysWhatIsWrongWithTheServersCertificate) {
  Daemon daemon(tls());
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  expect_says(render(address, trusting("other_ca.pem")), kUnavailable,
              "is not signed by a CA of " + folder_.path("other_ca.pem") +
                  "; give the one that signed it with --tls-ca");
  expect_says(render(address, {.tls = true}), kUnavailable, "is not signed by a CA of this system");
  ClientSecurity named = trusting();
  named.server_name = "example.org";
  expect_says(render(address, named), kUnavailable, "is not for the name example.org");
  named.server_name = "localhost";
  EXPECT_OK(render(address, named));

  put("server", ca_.issue("server", -absl::Hours(1)));
  Daemon expired(tls());
  expect_says(render(expired.wait_until_listening(), trusting()), kUnavailable,
              "has expired; the server's operator must renew it");
  EXPECT_TRUE(absl::StrContains(expired.errors(), "the certificate has expired")) << expired.errors();
}

TEST_F(Tls, PlainAndTlsDoNotMeetAndSaySo) {
  Daemon secure(tls());
  const std::string address = secure.wait_until_listening();
  ASSERT_NE(address, "") << secure.errors();
  expect_says(render(address, {}), kUnavailable, "speaks TLS and the client did not; give --tls");
  Daemon plain({"--listen", "127.0.0.1:0"});
  expect_says(render(plain.wait_until_listening(), trusting()), kUnavailable, "does not speak TLS");
}

TEST_F(Tls, AUnixSocketStaysPlain) {
  const std::string address = "unix:" + folder_.path("socket");
  Daemon daemon(tls({"--listen", address}));
  ASSERT_EQ(daemon.wait_until_listening(), address) << daemon.errors();
  EXPECT_OK(render(address, {}));
  EXPECT_OK(render(address, trusting())) << "over a socket its options count for nothing";
}

// The server's answer to a client that speaks this version alone: the protocol that they agreed on, or
// nothing.
std::string agreed(const std::string& address, int version) {
  SSL_CTX* context = SSL_CTX_new(TLS_client_method());
  SSL_CTX_set_security_level(context, 0);
  SSL_CTX_set_min_proto_version(context, version);
  SSL_CTX_set_max_proto_version(context, version);
  BIO* bio = BIO_new_ssl_connect(context);
  BIO_set_conn_hostname(bio, address.c_str());
  SSL* ssl = nullptr;
  BIO_get_ssl(bio, &ssl);
  constexpr unsigned char kProtocols[] = "\x02h2";
  SSL_set_alpn_protos(ssl, kProtocols, 3);
  std::string protocol;
  if (BIO_do_connect(bio) == 1) {
    const unsigned char* name = nullptr;
    unsigned int size = 0;
    SSL_get0_alpn_selected(ssl, &name, &size);
    protocol.assign(reinterpret_cast<const char*>(name), size);
  }
  BIO_free_all(bio);
  SSL_CTX_free(context);
  return protocol;
}

TEST_F(Tls, IsOneTwoOrLater) {
  Daemon daemon(tls());
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  EXPECT_EQ(agreed(address, TLS1_1_VERSION), "");
  EXPECT_EQ(agreed(address, TLS1_2_VERSION), "h2");
  EXPECT_EQ(agreed(address, TLS1_3_VERSION), "h2");
}

TEST_F(Tls, ListensBeyondLoopback) {
  std::vector<std::string> arguments = tls();
  arguments[1] = "0.0.0.0:0";
  Daemon daemon(arguments);
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  EXPECT_OK(render("127.0.0.1" + address.substr(address.rfind(':')), trusting()));
}

TEST_F(Mtls, OnlyThoseWithACertificateOfTheCaComeIn) {
  put("foreign", other_ca_.issue("client"));
  put("expired", ca_.issue("client", -absl::Hours(1)));
  Daemon daemon(tls({"--tls-client-ca", folder_.path("ca.pem")}));
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  EXPECT_OK(render(address, showing("client")));
  expect_says(render(address, trusting()), kUnavailable,
              "asks for a client certificate; give one with --tls-cert");
  expect_says(render(address, showing("foreign")), kUnavailable,
              "refuses the client certificate " + folder_.path("foreign.pem"));
  expect_says(render(address, showing("expired")), kUnavailable, "expired.pem, which has expired");
  expect_says(Connection::open(address, trusting())->health(), kUnavailable, "asks for a client certificate");
}

// The status of a call of any method with these values of the "authorization" and the "x-forwarded-for"
// metadata.
absl::Status call(const std::string& address, const std::string& method, const std::string& authorization,
                  const std::string& forwarded_for = "") {
  grpc::ClientContext context;
  if (!forwarded_for.empty()) context.AddMetadata("x-forwarded-for", forwarded_for);
  if (!authorization.empty()) context.AddMetadata("authorization", authorization);
  grpc::GenericStub stub(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()));
  grpc::CompletionQueue queue;
  grpc::ByteBuffer request, response;
  const grpc::Slice empty("");
  request = grpc::ByteBuffer(&empty, 1);
  const auto unary = stub.PrepareUnaryCall(&context, method, request, &queue);
  unary->StartCall();
  grpc::Status status;
  unary->Finish(&response, &status, nullptr);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  return absl::Status(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
}

TEST_F(Tokens, EveryMethodButHealthAsksForOne) {
  const std::string socket = "unix:" + folder_.path("socket");
  Daemon daemon(
      {"--listen", "127.0.0.1:0," + socket, "--token-file", folder_.path("tokens"), "--log-level", "debug"});
  const std::string both = daemon.wait_until_listening();
  ASSERT_NE(both, "") << daemon.errors();
  for (const std::string& address : {both.substr(0, both.find(' ')), socket}) {
    for (const char* method : {"/candela.v1.RenderService/GetServerInfo", "/candela.v1.RenderService/Render",
                               "/candela.v1.RenderService/Meter", "/candela.v1.RenderService/Stream",
                               "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
                               "/no.such/Method", "/grpc.health.v1.Healthy/Check"}) {
      const absl::Status missing = call(address, method, "");
      expect_says(missing, kUnauthenticated, "--token-file");
      for (const std::string& wrong :
           {absl::StrCat("Bearer ", kOtherToken), std::string(kToken), absl::StrCat("Bearer ", kToken, "x"),
            absl::StrCat("Basic ", kToken), std::string("Bearer "), std::string("Bearer 0123456789abcdef")}) {
        EXPECT_EQ(call(address, method, wrong), missing) << wrong << " is told from a missing one";
      }
    }
    EXPECT_OK(call(address, "/candela.v1.RenderService/GetServerInfo", absl::StrCat("Bearer ", kToken)));
    EXPECT_OK(call(address, "/candela.v1.RenderService/GetServerInfo", absl::StrCat("bearer ", kToken)));
    EXPECT_OK(call(address, "/grpc.health.v1.Health/Check", ""));
    ClientSecurity security{.token_file = folder_.path("token")};
    EXPECT_OK(render(address, security));
    security.token_file = folder_.path("other_token");
    expect_says(render(address, security), kUnauthenticated, "--token-file");
    expect_says(render(address, {}), kUnauthenticated, "--token-file");
  }
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(), 0);
  // Only the log tells a missing token from an unknown one.
  for (const char* reason : {"no token", "unknown token"}) {
    EXPECT_TRUE(absl::StrContains(daemon.errors(), reason)) << daemon.errors();
  }
  EXPECT_FALSE(absl::StrContains(daemon.errors(), "0123456789abcdef")) << daemon.errors();
}

// Only a proxy on a unix: socket is believed.
TEST_F(Tokens, TheLogNamesTheClientOfACallThatIsRefused) {
  const std::string socket = "unix:" + folder_.path("socket");
  for (const auto& [listen, peer] : std::vector<std::pair<std::string, std::string>>{
           {socket, "peer=203.0.113.9"}, {"127.0.0.1:0", "peer=127.0.0.1 "}, {"[::1]:0", "peer=::/64 "}}) {
    Daemon daemon({"--listen", listen, "--token-file", folder_.path("tokens")});
    const std::string address = daemon.wait_until_listening();
    ASSERT_NE(address, "") << daemon.errors();
    call(address, "/candela.v1.RenderService/GetServerInfo", "", "198.51.100.1, 203.0.113.9").IgnoreError();
    daemon.signal(SIGTERM);
    EXPECT_EQ(daemon.wait(), 0);
    EXPECT_TRUE(absl::StrContains(daemon.errors(), "call refused")) << daemon.errors();
    EXPECT_TRUE(absl::StrContains(daemon.errors(), peer)) << daemon.errors();
  }
}

TEST_F(Tokens, TheLogNamesTheClientOfACallThatIsRefusedOverTls) {
  Daemon daemon(tls({"--token-file", folder_.path("tokens")}));
  const std::string address = daemon.wait_until_listening();
  expect_says(render(address, trusting()), kUnauthenticated, "--token-file");
  EXPECT_TRUE(absl::StrContains(daemon.errors(), "peer=127.0.0.1 ")) << daemon.errors();
}

// A socket at 127.0.0.1's `port` from another of this machine's addresses, which stays open and silent.
int connect_from(const std::string& source, int port) {
  const int descriptor = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  inet_pton(AF_INET, source.c_str(), &address.sin_addr);
  EXPECT_EQ(bind(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
  address.sin_port = htons(static_cast<uint16_t>(port));
  EXPECT_EQ(connect(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  return descriptor;
}

// gRPC does not say who called. See `Ports` in grpc_listener.cc.
TEST_F(Tokens, TheLogNamesTheRefusedClientAmongOthersAndTheCandidatesBeyondSixtyFour) {
  Daemon daemon({"--listen", "127.0.0.1:0", "--token-file", folder_.path("tokens")});
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  const int port = std::stoi(address.substr(address.rfind(':') + 1));
  const std::string method = "/candela.v1.RenderService/GetServerInfo";
  std::vector<int> others;
  for (int i = 2; i < 50; ++i) others.push_back(connect_from(absl::StrCat("127.0.1.", i), port));
  call(address, method, "").IgnoreError();
  EXPECT_TRUE(absl::StrContains(daemon.errors(), "peer=127.0.0.1 ")) << daemon.errors();
  for (int i = 50; i < 150; ++i) others.push_back(connect_from(absl::StrCat("127.0.1.", i), port));
  call(address, method, "Bearer of nothing").IgnoreError();
  EXPECT_TRUE(absl::StrContains(daemon.errors(), "one of 127.0.0.1, 127.0.1.")) << daemon.errors();
  for (const int descriptor : others) close(descriptor);
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(), 0);
}

TEST_F(Tokens, GoOverTlsToo) {
  Daemon daemon(tls({"--token-file", folder_.path("tokens")}));
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  ClientSecurity security = trusting();
  expect_says(render(address, security), kUnauthenticated, "--token-file");
  security.token_file = folder_.path("token");
  EXPECT_OK(render(address, security));
  EXPECT_OK(Connection::open(address, trusting())->health());
}

TEST_F(Tokens, NeverGoBeyondThisMachineInTheClear) {
  const ClientSecurity token{.token_file = folder_.path("token")};
  for (const char* beyond : {"192.0.2.1:50051", "example.org:1", "127.example.org:1", "[2001:db8::1]:1"}) {
    expect_says(Connection::open(beyond, token).status(), kInvalid, "in the clear");
  }
  ClientSecurity secure = token;
  secure.tls = true;
  EXPECT_OK(Connection::open("192.0.2.1:50051", secure));
  EXPECT_OK(Connection::open("[::1]:50051", token));
}

TEST_F(SecurityFiles, OfAClientThatCannotBeUsedAreNamed) {
  const auto opened = [](const ClientSecurity& security) {
    return Connection::open("127.0.0.1:1", security).status();
  };
  expect_says(opened({.ca_file = "/no/such/ca"}), kInvalid, "/no/such/ca");
  expect_says(opened({.ca_file = put("text", "no PEM")}), kInvalid, "is not PEM");
  expect_says(opened({.cert_file = folder_.path("client.pem")}), kInvalid, "--tls-key");
  expect_says(opened({.cert_file = folder_.path("client.pem"), .key_file = folder_.path("server.key")}),
              kInvalid, "no PEM private key of the client certificate");
  expect_says(opened({.key_file = folder_.path("client.key")}), kInvalid, "--tls-cert");
  expect_says(opened({.token_file = "/no/such/token"}), kInvalid, "/no/such/token");
  expect_says(opened({.token_file = put("empty", "# none\n")}), kInvalid, "holds no token");
  expect_says(opened({.token_file = put("spaces", "one two\n")}), kInvalid, "holds a space");
}

// Before anything listens: each ends candelad with one line that names the option, the file and the reason.
TEST_F(SecurityFiles, OfAServerThatCannotBeUsedAreNamed) {
  const Issued other = ca_.issue("other");
  struct Case {
    std::string option, file, text, reason;
  };
  std::string damaged = ca_.cert();
  damaged[damaged.size() / 2] = '!';
  for (const Case& bad :
       std::vector<Case>{{"tls-cert", "server.pem", "", "holds no PEM certificate"},
                         {"tls-cert", "server.pem", damaged, "damaged PEM"},
                         {"tls-cert", "server.pem", ca_.cert() + damaged, "damaged PEM: certificate 2"},
                         {"tls-key", "server.key", "text", "holds no PEM private key"},
                         {"tls-key", "server.key", other.key, "is not the key of the first certificate in"},
                         {"tls-key", "server.key", with_passphrase(other.key), "has a passphrase"},
                         {"tls-client-ca", "ca.pem", "text", "holds no PEM certificate"},
                         {"token-file", "tokens", "", "holds no token"},
                         {"token-file", "tokens", "# one\n\nshort-token\n", "line 3"},
                         {"token-file", "tokens", "a token with some spaces\n", "line 1"}}) {
    SetUp();
    put(bad.file, bad.text);
    Daemon daemon(tls({"--tls-client-ca", folder_.path("ca.pem"), "--token-file", folder_.path("tokens")}));
    ASSERT_EQ(daemon.wait_until_listening(), "");
    EXPECT_EQ(daemon.wait(), 1);
    const std::string errors = daemon.errors();
    const std::string line = errors.substr(errors.find("candelad: "));
    EXPECT_TRUE(absl::StartsWith(line, absl::StrCat("candelad: ", bad.option, ": "))) << line;
    EXPECT_TRUE(absl::StrContains(line, bad.reason)) << line;
    EXPECT_TRUE(absl::StrContains(line, folder_.path(bad.file))) << line;
    EXPECT_EQ(std::count(line.begin(), line.end(), '\n'), 1) << line;
    EXPECT_FALSE(absl::StrContains(line, "short-token")) << line;
  }
  SetUp();
  for (const auto& [option, file] :
       std::vector<std::pair<std::string, std::string>>{{"tls-cert", "server.pem"},
                                                        {"tls-key", "server.key"},
                                                        {"tls-client-ca", "ca.pem"},
                                                        {"token-file", "tokens"}}) {
    std::vector<std::string> arguments =
        tls({"--tls-client-ca", folder_.path("ca.pem"), "--token-file", folder_.path("tokens")});
    std::replace(arguments.begin(), arguments.end(), folder_.path(file), std::string("/no/such/file"));
    Daemon daemon(arguments);
    ASSERT_EQ(daemon.wait_until_listening(), "");
    EXPECT_EQ(daemon.wait(), 1);
    EXPECT_TRUE(absl::StrContains(daemon.errors(), option + ": cannot read /no/such/file"))
        << daemon.errors();
  }
  EXPECT_EQ(chmod(folder_.path("server.key").c_str(), 0644), 0);
  Daemon daemon(tls());
  ASSERT_EQ(daemon.wait_until_listening(), "");
  EXPECT_EQ(daemon.wait(), 1);
  EXPECT_TRUE(absl::StrContains(daemon.errors(), "chmod 600")) << daemon.errors();
}

// Certificate and token files that change while candelad serves, and a TLS session that loses its
// server.

using Rotation = SecurityTest;

TEST_F(Rotation, OfTheCertificateIsSeenByNewConnectionsAndHoldsNoOldOneUp) {
  Daemon daemon(tls());
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  const Connection before = *Connection::open(address, trusting());
  EXPECT_OK(render(before));
  put("server", other_ca_.issue("server"));
  EXPECT_TRUE(soon([&] { return render(address, trusting("other_ca.pem")).ok(); })) << daemon.errors();
  EXPECT_FALSE(render(address, trusting()).ok());
  EXPECT_OK(render(before));

  // A bad file is logged, and the last good contents stay in force.
  const Issued next = ca_.issue("server");
  put("server.pem", next.cert);
  EXPECT_TRUE(soon([&] { return absl::StrContains(daemon.errors(), "is not the key of the first"); }))
      << daemon.errors();
  EXPECT_OK(render(address, trusting("other_ca.pem")));
  put("server.pem", "-----BEGIN CERTIFICATE-----\nrubbish\n");
  EXPECT_TRUE(soon([&] { return absl::StrContains(daemon.errors(), "damaged PEM"); })) << daemon.errors();
  EXPECT_OK(render(address, trusting("other_ca.pem")));
  std::remove(folder_.path("server.pem").c_str());
  EXPECT_TRUE(soon([&] { return absl::StrContains(daemon.errors(), "cannot read"); })) << daemon.errors();
  EXPECT_OK(render(address, trusting("other_ca.pem")));

  put("server", next);
  EXPECT_TRUE(soon([&] { return render(address, trusting()).ok(); })) << daemon.errors();
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(), 0);
}

TEST_F(Rotation, OfTheCertificateMovesTheExpiryThatMetricsShow) {
  Config config;
  config.listen = {"127.0.0.1:0"};
  config.metrics = "127.0.0.1:0";
  config.memory_budget_bytes = uint64_t{64} << 20;
  config.tls_cert = folder_.path("server.pem");
  config.tls_key = folder_.path("server.key");
  ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Server> server,
                       Server::start(config, real_clock(), alarm_timers()));
  keep_driver_loaded();
  const auto days_left = [&] {
    const absl::Time expires = absl::FromUnixSeconds(
        static_cast<int64_t>(scrape(*server).at("candela_certificate_expiry_timestamp_seconds")));
    return absl::ToDoubleHours(expires - absl::Now()) / 24;
  };
  EXPECT_NEAR(days_left(), 1, 0.1);
  put("server", ca_.issue("server", absl::Hours(24 * 90)));
  EXPECT_TRUE(soon([&] { return days_left() > 2; }));
  EXPECT_NEAR(days_left(), 90, 0.1);
  put("server.pem", "rubbish");  // what is in force has not changed
  absl::SleepFor(absl::Seconds(3));
  EXPECT_NEAR(days_left(), 90, 0.1);
  put("server", ca_.issue("server", -absl::Hours(24)));
  EXPECT_TRUE(soon([&] { return days_left() < 0; }));
}

TEST_F(Rotation, OfTheClientsCaIsSeenByNewConnections) {
  put("clients_ca.pem", ca_.cert());
  put("foreign", other_ca_.issue("client"));
  Daemon daemon(tls({"--tls-client-ca", folder_.path("clients_ca.pem")}));
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  EXPECT_OK(render(address, showing("client")));
  EXPECT_FALSE(render(address, showing("foreign")).ok());
  put("clients_ca.pem", other_ca_.cert());
  EXPECT_TRUE(soon([&] { return render(address, showing("foreign")).ok(); })) << daemon.errors();
  EXPECT_FALSE(render(address, showing("client")).ok());
}

TEST_F(Rotation, OfTokensIsSeenByTheNextCalls) {
  Daemon daemon({"--listen", "127.0.0.1:0", "--token-file", folder_.path("tokens")});
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  const Connection connection = *Connection::open(address, {.token_file = folder_.path("token")});
  const ClientSecurity other{.token_file = folder_.path("other_token")};
  EXPECT_OK(render(connection));
  EXPECT_FALSE(render(address, other).ok());
  put("tokens", absl::StrCat(kToken, "\n", kOtherToken, "\n"));
  EXPECT_TRUE(soon([&] { return render(address, other).ok(); })) << daemon.errors();
  EXPECT_OK(render(connection));
  put("tokens", absl::StrCat(kOtherToken, "\n"));
  EXPECT_TRUE(soon([&] { return absl::IsUnauthenticated(render(connection)); })) << daemon.errors();

  // The client reads its file again for each call.
  put("token", absl::StrCat(kOtherToken, "\n"));
  EXPECT_OK(render(connection));

  put("tokens", "");
  EXPECT_TRUE(soon([&] { return absl::StrContains(daemon.errors(), "holds no token"); })) << daemon.errors();
  EXPECT_OK(render(connection)) << "the tokens before stay in force";
}

TEST_F(Rotation, ASessionGoesOnOnAnotherServerOverTls) {
  put("keys", "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n");
  const std::vector<std::string> arguments =
      tls({"--resume-keys", folder_.path("keys"), "--tls-client-ca", folder_.path("ca.pem"), "--token-file",
           folder_.path("tokens")});
  Daemon first(arguments);
  Daemon second(arguments);
  SessionOptions options;
  options.security = showing("client");
  options.security.token_file = folder_.path("token");
  options.servers = {first.wait_until_listening(), second.wait_until_listening()};
  constexpr size_t kFrames = 40;
  const Film film = make_film(kFrames, 160, 90);
  const SessionRun undisturbed = run_session(Session::open(options), film);
  ASSERT_OK(undisturbed.status);
  const SessionRun run = run_session(Session::open(options), film, [&](size_t results) {
    if (results == kFrames / 4) first.signal(SIGKILL);
  });
  EXPECT_OK(run.status);
  EXPECT_EQ(run.images, undisturbed.images);
  EXPECT_EQ(run.stats.resumes, 1u);
  EXPECT_EQ(run.stats.server, options.servers[1]);
}

TEST_F(Rotation, ASessionWithoutWhatTheServersAskForSaysSo) {
  Daemon daemon(tls({"--token-file", folder_.path("tokens")}));
  SessionOptions options;
  options.servers = {daemon.wait_until_listening()};
  expect_says(Session::open(options).status(), absl::StatusCode::kUnavailable, "give --tls");
  options.security = trusting("other_ca.pem");
  expect_says(Session::open(options).status(), absl::StatusCode::kUnavailable, "--tls-ca");
  options.security = trusting();
  expect_says(Session::open(options).status(), absl::StatusCode::kUnauthenticated, "--token-file");
}

}  // namespace
}  // namespace candela::testing
