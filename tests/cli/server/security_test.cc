// The command with a candelad that requires TLS, a client certificate and a token.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <memory>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/service/test_ca.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class Secure : public ::testing::Test {
 protected:
  std::string put(const std::string& name, const std::string& text) {
    write_file(folder_.path(name), text);
    EXPECT_EQ(chmod(folder_.path(name).c_str(), S_IRUSR | S_IWUSR), 0);
    return folder_.path(name);
  }
  void SetUp() override {
    write_small_exr(in_);
    const testing::Issued server = ca_.issue("server");
    const testing::Issued client = ca_.issue("client");
    put("ca.pem", ca_.cert());
    put("server.pem", server.cert);
    put("server.key", server.key);
    put("client.pem", client.cert);
    put("client.key", client.key);
    put("token", "0123456789abcdef\n");
    daemon_ = std::make_unique<ListeningDaemon>(std::vector<std::string>{
        "--tls-cert", folder_.path("server.pem"), "--tls-key", folder_.path("server.key"), "--tls-client-ca",
        folder_.path("ca.pem"), "--token-file", folder_.path("token")});
    ASSERT_NE(daemon_->address(), "");
  }
  std::vector<std::string> secured(std::vector<std::string> arguments, bool with_token = true) const {
    arguments.insert(arguments.end(),
                     {"--server", daemon_->address(), "--tls-ca", folder_.path("ca.pem"), "--tls-cert",
                      folder_.path("client.pem"), "--tls-key", folder_.path("client.key")});
    if (with_token) arguments.insert(arguments.end(), {"--token-file", folder_.path("token")});
    return arguments;
  }

  const testing::TestCa ca_{"Candela test CA"};
  TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  std::unique_ptr<ListeningDaemon> daemon_;
};

TEST_F(Secure, EveryCommandGetsThrough) {
  const std::vector<std::vector<std::string>> commands = {
      {"render", in_, folder_.path("out.png"), "-q"},
      {"stream", in_, folder_.path("out_%d.png"), "-q"},
      {"meter", in_},
      {"info"},
      {"bench", "--size", "16x16", "--seconds", "0.2", "-q"}};
  for (const std::vector<std::string>& command : commands) {
    const Outcome outcome = candela(secured(command));
    EXPECT_EQ(outcome.code, 0) << command[0] << ": " << outcome.err;
    const Outcome without = candela(secured(command, false));
    EXPECT_EQ(without.code, 4) << command[0];
    EXPECT_TRUE(says(without.err, "--token-file"));
  }
  const Outcome health = candela(secured({"health"}, false));
  EXPECT_EQ(health.code, 0) << health.err;
  EXPECT_EQ(health.out, "SERVING\n");
}

TEST_F(Secure, VariablesStandForOptions) {
  setenv("CANDELA_CLIENT_TLS_CA", folder_.path("ca.pem").c_str(), 1);
  setenv("CANDELA_CLIENT_TLS_CERT", folder_.path("client.pem").c_str(), 1);
  setenv("CANDELA_CLIENT_TLS_KEY", folder_.path("client.key").c_str(), 1);
  setenv("CANDELA_CLIENT_TOKEN_FILE", folder_.path("token").c_str(), 1);
  const Outcome outcome = candela({"info", "--server", daemon_->address()});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  for (const char* name : {"CA", "CERT", "KEY"})
    unsetenv((std::string("CANDELA_CLIENT_TLS_") + name).c_str());
  unsetenv("CANDELA_CLIENT_TOKEN_FILE");
}

TEST_F(Secure, WhatIsMissingIsSaidInOneLine) {
  const auto expect_line = [](const Outcome& outcome, int code, const std::string& words) {
    EXPECT_EQ(outcome.code, code);
    EXPECT_TRUE(says(outcome.err, words));
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  };
  const std::string& server = daemon_->address();
  expect_line(candela({"health", "--server", server}), 1, "speaks TLS");
  expect_line(candela({"health", "--server", server, "--tls"}), 1, "--tls-ca");
  expect_line(candela({"health", "--server", server, "--tls-ca", folder_.path("ca.pem")}), 1,
              "asks for a client certificate");
  expect_line(candela({"health", "--server", server, "--tls-ca", "/no/such/file"}), 2, "/no/such/file");
  expect_line(candela({"info", "--server", "192.0.2.1:1", "--token-file", folder_.path("token")}), 2,
              "in the clear");
}

}  // namespace
}  // namespace candela
