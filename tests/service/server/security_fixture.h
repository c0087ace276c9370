// Certificate and token files for a candelad and its clients.
#pragma once

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <string>
#include <vector>

#include "absl/time/clock.h"
#include "client/connection.h"
#include "tests/service/server/test_ca.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/scenes.h"
#include "tests/support/status.h"

namespace candela::testing {

inline constexpr char kToken[] = "0123456789abcdef-one";
inline constexpr char kOtherToken[] = "0123456789abcdef-two";

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
inline void expect_says(const absl::Status& status, absl::StatusCode code, const std::string& words) {
  EXPECT_EQ(status.code(), code) << status;
  EXPECT_TRUE(says(status.message(), words));
  EXPECT_EQ(std::string(status.message()).find('\n'), std::string::npos) << status;
}

}  // namespace candela::testing
