#include "server/config.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "server/base/units.h"
#include "server/listen_address.h"
#include "tests/support/files.h"

namespace candela {
namespace {

absl::StatusOr<Invocation> parse(std::vector<const char*> arguments) {
  arguments.insert(arguments.begin(), "candelad");
  return parse_invocation(static_cast<int>(arguments.size()), arguments.data());
}

// A variable of the environment for the length of a test.
class Variable {
 public:
  Variable(const char* name, const char* value) : name_(name) { setenv(name, value, 1); }
  ~Variable() { unsetenv(name_); }

 private:
  const char* name_;
};

std::set<std::string> keys_of(const std::string& path) {
  std::set<std::string> keys;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    const size_t equals = line.find(" = ");
    if (!line.empty() && line[0] != '#' && equals != std::string::npos) keys.insert(line.substr(0, equals));
  }
  return keys;
}

void expect_equal(const Invocation& a, const Invocation& b) {
  EXPECT_EQ(a.config.listen, b.config.listen);
  EXPECT_EQ(a.config.insecure, b.config.insecure);
  EXPECT_EQ(a.config.tls_cert, b.config.tls_cert);
  EXPECT_EQ(a.config.tls_key, b.config.tls_key);
  EXPECT_EQ(a.config.tls_client_ca, b.config.tls_client_ca);
  EXPECT_EQ(a.config.token_file, b.config.token_file);
  EXPECT_EQ(a.config.device, b.config.device);
  EXPECT_EQ(a.config.validation, b.config.validation);
  EXPECT_EQ(a.config.cache_dir, b.config.cache_dir);
  EXPECT_EQ(a.config.memory_budget_bytes, b.config.memory_budget_bytes);
  EXPECT_EQ(a.config.max_frame_bytes, b.config.max_frame_bytes);
  EXPECT_EQ(a.config.max_dimension, b.config.max_dimension);
  EXPECT_EQ(a.config.max_calls, b.config.max_calls);
  EXPECT_EQ(a.config.idle_timeout, b.config.idle_timeout);
  EXPECT_EQ(a.config.drain_timeout, b.config.drain_timeout);
  EXPECT_EQ(a.config.max_sessions, b.config.max_sessions);
  EXPECT_EQ(a.config.max_frames_in_flight, b.config.max_frames_in_flight);
  EXPECT_EQ(a.config.encoder_threads, b.config.encoder_threads);
  EXPECT_EQ(a.config.pre_drain, b.config.pre_drain);
  EXPECT_EQ(a.config.resume_keys, b.config.resume_keys);
  EXPECT_EQ(a.config.resume_ttl, b.config.resume_ttl);
  EXPECT_EQ(a.config.metrics, b.config.metrics);
  EXPECT_EQ(a.log.level, b.log.level);
  EXPECT_EQ(a.log.json, b.log.json);
}

TEST(Config, TheAnnotatedFileHoldsEveryOptionAtItsDefault) {
  const absl::StatusOr<Invocation> from_file = parse({"--config", CANDELA_CONF});
  ASSERT_TRUE(from_file.ok()) << from_file.status();
  const absl::StatusOr<Invocation> defaults = parse({});
  ASSERT_TRUE(defaults.ok());
  expect_equal(*from_file, *defaults);
}

TEST(Config, TheAnnotatedFileListsExactlyTheOptionsThatExist) {
  const absl::StatusOr<Invocation> help = parse({"--help"});
  ASSERT_TRUE(help.ok());
  std::set<std::string> options;
  std::istringstream lines(help->text);
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("  --", 0) == 0) options.insert(line.substr(4, line.find(' ', 4) - 4));
  }
  for (const char* not_a_key : {"config", "list-devices", "version"}) EXPECT_EQ(options.erase(not_a_key), 1u);
  EXPECT_EQ(keys_of(CANDELA_CONF), options);
  EXPECT_EQ(options.size(), 24u);
}

TEST(Config, FlagsWinOverVariablesAndVariablesOverTheFile) {
  const TemporaryFile file("max-calls = 5\nmax-dimension = 100\nmemory-budget = \"1GiB\"\nlog-json = true\n");
  const Variable calls("CANDELA_MAX_CALLS", "6");
  const Variable dimension("CANDELA_MAX_DIMENSION", "200");
  const absl::StatusOr<Invocation> invocation = parse({"--config", file.path().c_str(), "--max-calls", "7"});
  ASSERT_TRUE(invocation.ok()) << invocation.status();
  EXPECT_EQ(invocation->config.max_calls, 7u);
  EXPECT_EQ(invocation->config.max_dimension, 200u);
  EXPECT_EQ(invocation->config.memory_budget_bytes, uint64_t{1} << 30);
  EXPECT_TRUE(invocation->log.json);
}

TEST(Config, SessionsOptionsAreRead) {
  const Variable keys("CANDELA_RESUME_KEYS", "/etc/candela/keys");
  const TemporaryFile file("resume-ttl = \"1h\"\nmetrics = \"127.0.0.1:9090\"\n");
  const absl::StatusOr<Invocation> invocation =
      parse({"--config", file.path().c_str(), "--max-sessions", "3", "--max-frames-in-flight", "4",
             "--encoder-threads", "5", "--pre-drain", "6s"});
  ASSERT_TRUE(invocation.ok()) << invocation.status();
  EXPECT_EQ(invocation->config.max_sessions, 3u);
  EXPECT_EQ(invocation->config.max_frames_in_flight, 4u);
  EXPECT_EQ(invocation->config.encoder_threads, 5u);
  EXPECT_EQ(invocation->config.pre_drain, absl::Seconds(6));
  EXPECT_EQ(invocation->config.resume_keys, "/etc/candela/keys");
  EXPECT_EQ(invocation->config.resume_ttl, absl::Hours(1));
  EXPECT_EQ(invocation->config.metrics, "127.0.0.1:9090");
  EXPECT_TRUE(parse({"--metrics", "0.0.0.0:9090", "--insecure"}).ok());
}

TEST(Config, SecurityIsRead) {
  const Variable key("CANDELA_TLS_KEY", "/etc/candela/key");
  const TemporaryFile file("tls-cert = \"/etc/candela/cert\"\ntls-client-ca = \"/etc/candela/ca\"\n");
  const absl::StatusOr<Invocation> invocation = parse(
      {"--config", file.path().c_str(), "--token-file", "/etc/candela/tokens", "--listen", "0.0.0.0:1"});
  ASSERT_TRUE(invocation.ok()) << invocation.status();
  EXPECT_EQ(invocation->config.tls_cert, "/etc/candela/cert");
  EXPECT_EQ(invocation->config.tls_key, "/etc/candela/key");
  EXPECT_EQ(invocation->config.tls_client_ca, "/etc/candela/ca");
  EXPECT_EQ(invocation->config.token_file, "/etc/candela/tokens");
}

TEST(Config, ListenTakesSeveralAddresses) {
  const absl::StatusOr<Invocation> invocation = parse({"--listen", "localhost:0,unix:/tmp/c.sock,[::1]:7"});
  ASSERT_TRUE(invocation.ok()) << invocation.status();
  EXPECT_EQ(invocation->config.listen,
            (std::vector<std::string>{"localhost:0", "unix:/tmp/c.sock", "[::1]:7"}));
}

TEST(Config, RefusesInOneLineThatNamesTheOption) {
  const TemporaryFile unknown_key("max-cals = 5\n");
  const std::vector<std::pair<std::vector<const char*>, std::string>> cases = {
      {{"--max-calls", "0"}, "max-calls"},
      {{"--max-calls", "many"}, "max-calls"},
      {{"--max-dimension", "16385"}, "max-dimension"},
      {{"--memory-budget", "2 sheep"}, "memory-budget"},
      {{"--memory-budget", "1KiB"}, "memory-budget"},
      {{"--max-frame-bytes", "5GiB"}, "max-frame-bytes"},
      {{"--idle-timeout", "60"}, "idle-timeout"},
      {{"--idle-timeout", "-1s"}, "idle-timeout"},
      {{"--drain-timeout", "2h"}, "drain-timeout"},
      {{"--max-sessions", "0"}, "max-sessions"},
      {{"--max-sessions", "4097"}, "max-sessions"},
      {{"--max-frames-in-flight", "17"}, "max-frames-in-flight"},
      {{"--encoder-threads", "257"}, "encoder-threads"},
      {{"--pre-drain", "601s"}, "pre-drain"},
      {{"--resume-ttl", "0"}, "resume-ttl"},
      {{"--metrics", "unix:/tmp/m.sock"}, "metrics"},
      {{"--metrics", "9090"}, "9090"},
      {{"--metrics", "[::1]:9090"}, "IPv4"},
      {{"--metrics", "0.0.0.0:9090"}, "--insecure"},
      {{"--metrics", "0.0.0.0:9090", "--tls-cert", "c", "--tls-key", "k"}, "--insecure"},
      {{"--listen", "0.0.0.0:1", "--token-file", "t"}, "--tls-cert"},
      {{"--tls-cert", "c"}, "tls-cert is given without tls-key"},
      {{"--tls-key", "k"}, "tls-key is given without tls-cert"},
      {{"--tls-client-ca", "ca"}, "tls-client-ca"},
      {{"--log-level", "loud"}, "log-level"},
      {{"--listen", "nowhere"}, "nowhere"},
      {{"--lisen", "127.0.0.1:1"}, "--lisen"},
      {{"--config", "/no/such/file"}, "/no/such/file"},
      {{"--config", unknown_key.path().c_str()}, "max-cals"},
  };
  for (const auto& [arguments, named] : cases) {
    const absl::Status status = parse(arguments).status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << named;
    EXPECT_NE(std::string(status.message()).find(named), std::string::npos) << status;
    EXPECT_EQ(std::string(status.message()).find('\n'), std::string::npos) << status;
  }
}

TEST(ListenAddress, BeyondLoopbackNeedsInsecure) {
  for (const char* loopback :
       {"127.0.0.1:50051", "127.9.9.9:0", "localhost:1", "[::1]:65535", "unix:/run/c.sock"}) {
    EXPECT_TRUE(check_listen_address(loopback, false).ok()) << loopback;
  }
  for (const char* beyond : {"0.0.0.0:1", "[::]:1", "192.168.0.1:1", "example.org:1", "[fe80::1]:1"}) {
    const absl::Status status = check_listen_address(beyond, false);
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << beyond;
    EXPECT_NE(std::string(status.message()).find("--insecure"), std::string::npos) << status;
    EXPECT_TRUE(check_listen_address(beyond, true).ok()) << beyond;
  }
}

// A name that only begins like a loopback address belongs to whoever owns the domain.
TEST(ListenAddress, ANameThatLooksLikeLoopbackIsNot) {
  EXPECT_FALSE(check_listen_address("127.example.org:1", false).ok());
  EXPECT_FALSE(check_listen_address("localhost.example.org:1", false).ok());
}

TEST(ListenAddress, RefusesOtherShapes) {
  for (const char* bad : {"", "50051", ":50051", "host:", "host:70000", "host:-1", "unix:", "::1:5", "[::1]",
                          "a/b:1", "dns:///a:1", "[]:1", "host:1x"}) {
    EXPECT_FALSE(check_listen_address(bad, true).ok()) << bad;
  }
}

TEST(Units, BytesAndTimes) {
  EXPECT_EQ(parse_bytes("0").value(), 0u);
  EXPECT_EQ(parse_bytes("1048576").value(), 1048576u);
  EXPECT_EQ(parse_bytes("512MiB").value(), uint64_t{512} << 20);
  EXPECT_EQ(parse_bytes("2g").value(), uint64_t{2} << 30);
  EXPECT_EQ(parse_bytes("16777215TiB").value(), uint64_t{16777215} << 40);
  for (const char* bad :
       {"", "GiB", "-1", "1.5GiB", "16777216TiB", "1 GiB", "1GB", "0x10", "99999999999999999999"}) {
    EXPECT_FALSE(parse_bytes(bad).ok()) << bad;
  }
  for (uint64_t bytes : {uint64_t{0}, uint64_t{1}, uint64_t{1024}, uint64_t{3} << 30, ~uint64_t{0}}) {
    EXPECT_EQ(parse_bytes(format_bytes(bytes)).value(), bytes);
  }
  EXPECT_EQ(parse_duration("1m30s").value(), absl::Seconds(90));
  EXPECT_FALSE(parse_duration("90").ok());
}

}  // namespace
}  // namespace candela
