// Certificate and token files that change while candelad serves, and a TLS session that loses its
// server.
#include <csignal>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/session.h"
#include "server/server.h"
#include "tests/service/real_time.h"
#include "tests/service/server/scrape.h"
#include "tests/service/server/security_fixture.h"
#include "tests/service/sessions/session_run.h"
#include "tests/support/driver.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

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
