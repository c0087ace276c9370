#include "server/config.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <tuple>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/base/words.h"
#include "server/daemon/flags.h"
#include "tests/support/files.h"
#include "tests/support/process.h"
#include "tests/support/status.h"

namespace candela {
namespace {

absl::StatusOr<Invocation> parse(std::vector<const char*> arguments) {
  arguments.insert(arguments.begin(), "candelad");
  return parse_invocation(static_cast<int>(arguments.size()), arguments.data());
}

TEST(Config, TheAnnotatedFileIsGeneratedFromTheTable) {
  ASSERT_OK_AND_ASSIGN(const Invocation printed, parse({"--print-config"}));
  EXPECT_EQ(read_file(CANDELA_CONF), printed.text) << "run: candelad --print-config >deploy/candelad.conf";
}

TEST(Config, TheAnnotatedFileSetsEveryOptionToItsDefault) {
  ASSERT_OK_AND_ASSIGN(const Invocation from_file, parse({"--config", CANDELA_CONF}));
  ASSERT_OK_AND_ASSIGN(const Invocation defaults, parse({}));
  for (const Option& option : option_table()) {
    EXPECT_EQ(value_text(option, from_file.config), value_text(option, defaults.config)) << option.name;
  }
}

TEST(Config, HelpNamesTheFlagTheVariableAndTheRangeOfEveryOption) {
  ASSERT_OK_AND_ASSIGN(const Invocation help, parse({"--help"}));
  for (const Option& option : option_table()) {
    for (const std::string& text : {absl::StrCat("  --", option.name, " "),
                                    absl::StrCat("(Env:", variable_name(option), ")"), range_text(option)}) {
      EXPECT_TRUE(says(help.text, text));
    }
  }
}

// check_config is for programs that fill a Config themselves.
TEST(Config, AnEmbeddedServersConfigIsCheckedByTheSameTable) {
  EXPECT_OK(check_config({}));
  Config config;
  config.max_calls = 4097;
  EXPECT_EQ(check_config(config).message(), "max-calls is 4097; it must be 1 .. 4096");
  config = {};
  config.memory_budget_bytes = 1;
  EXPECT_EQ(check_config(config).message(), "memory-budget is 1; it must be 0, or 1MiB .. 1TiB");
  config = {};
  config.pre_drain = absl::Minutes(11);
  EXPECT_EQ(check_config(config).message(), "pre-drain is 11m; it must be 0 .. 10m");
}

TEST(Config, FlagsWinOverVariablesAndVariablesOverTheFile) {
  const TemporaryFile file("max-calls = 5\nmax-dimension = 100\nmemory-budget = \"1GiB\"\nlog-json = true\n");
  const Variable calls("CANDELA_MAX_CALLS", "6");
  const Variable dimension("CANDELA_MAX_DIMENSION", "200");
  ASSERT_OK_AND_ASSIGN(const Invocation invocation,
                       parse({"--config", file.path().c_str(), "--max-calls", "7"}));
  EXPECT_EQ(invocation.config.max_calls, 7u);
  EXPECT_EQ(invocation.config.max_dimension, 200u);
  EXPECT_EQ(invocation.config.memory_budget_bytes, uint64_t{1} << 30);
  EXPECT_TRUE(invocation.config.log_json);
}

TEST(Config, SessionsOptionsAreRead) {
  const Variable keys("CANDELA_RESUME_KEYS", "/etc/candela/keys");
  const TemporaryFile file("resume-ttl = \"1h\"\nmetrics = \"127.0.0.1:9090\"\n");
  ASSERT_OK_AND_ASSIGN(const Invocation invocation,
                       parse({"--config", file.path().c_str(), "--max-sessions", "3",
                              "--max-frames-in-flight", "4", "--encoder-threads", "5", "--pre-drain", "6s"}));
  EXPECT_EQ(invocation.config.max_sessions, 3u);
  EXPECT_EQ(invocation.config.max_frames_in_flight, 4u);
  EXPECT_EQ(invocation.config.encoder_threads, 5u);
  EXPECT_EQ(invocation.config.pre_drain, absl::Seconds(6));
  EXPECT_EQ(invocation.config.resume_keys, "/etc/candela/keys");
  EXPECT_EQ(invocation.config.resume_ttl, absl::Hours(1));
  EXPECT_EQ(invocation.config.metrics, "127.0.0.1:9090");
  EXPECT_OK(parse({"--metrics", "0.0.0.0:9090", "--insecure"}));
}

TEST(Config, SecurityIsRead) {
  const Variable key("CANDELA_TLS_KEY", "/etc/candela/key");
  const TemporaryFile file("tls-cert = \"/etc/candela/cert\"\ntls-client-ca = \"/etc/candela/ca\"\n");
  ASSERT_OK_AND_ASSIGN(const Invocation invocation, parse({"--config", file.path().c_str(), "--token-file",
                                                           "/etc/candela/tokens", "--listen", "0.0.0.0:1"}));
  EXPECT_EQ(invocation.config.tls_cert, "/etc/candela/cert");
  EXPECT_EQ(invocation.config.tls_key, "/etc/candela/key");
  EXPECT_EQ(invocation.config.tls_client_ca, "/etc/candela/ca");
  EXPECT_EQ(invocation.config.token_file, "/etc/candela/tokens");
}

TEST(Config, ListenTakesSeveralAddresses) {
  ASSERT_OK_AND_ASSIGN(const Invocation invocation,
                       parse({"--listen", "localhost:0,unix:/tmp/c.sock,[::1]:7"}));
  EXPECT_EQ(invocation.config.listen,
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
      {{"--metrics", "0.0.0.0:9090"}, "--insecure"},
      {{"--metrics", "0.0.0.0:9090", "--tls-cert", "c", "--tls-key", "k"}, "--insecure"},
      {{"--listen", "0.0.0.0:1", "--token-file", "t"}, "--tls-cert"},
      {{"--tls-cert", "c"}, "tls-cert is given without tls-key"},
      {{"--tls-key", "k"}, "tls-key is given without tls-cert"},
      {{"--tls-client-ca", "ca"}, "tls-client-ca"},
      {{"--device", "host", "--executor", "device"}, "device is host and executor is device"},
      {{"--log-level", "loud"}, "log-level"},
      {{"--listen", "nowhere"}, "nowhere"},
      {{"--lisen", "127.0.0.1:1"}, "unknown argument \"--lisen\"; did you mean --listen? see"},
      {{"serve"}, "unknown argument \"serve\"; see candelad --help"},
      {{"--config", "/no/such/file"}, "/no/such/file"},
      {{"--config", unknown_key.path().c_str()}, "max-cals"},
  };
  for (const auto& [arguments, named] : cases) {
    const absl::Status status = parse(arguments).status();
    EXPECT_REFUSED(kInvalidArgument, named, status);
    EXPECT_EQ(std::string(status.message()).find('\n'), std::string::npos) << status;
  }
}

TEST(Config, AnErrorInTheFileNamesItsLineAndKey) {
  for (const auto& [text, words] : std::vector<std::pair<std::string, std::string>>{
           {"# calls\nmax-cals = 5\n", ":2: unknown key \"max-cals\"; did you mean max-calls? see"},
           {"max_calls = 5\n", ":1: unknown key \"max_calls\"; did you mean max-calls?"},
           {"zzz = 5\n", ":1: unknown key \"zzz\"; see candelad --print-config"},
           {"a.b = 5\n", ":1: unknown key \"a.b\""},
           {"config = 5\n", ":1: unknown key \"config\""},
           {"\n\nmax-calls = 0\n", ":3: max-calls is 0; it must be 1 .. 4096"},
           {"max-calls = many\n", ":1: max-calls is \"many\": it must be a whole number"},
           {"max-calls\n", ":1: max-calls is \"true\": it must be a whole number"},
           {"log-json = perhaps\n", ":1: log-json is \"perhaps\": it must be true or false"},
           {"memory-budget = \"2 sheep\"\n", ":1: memory-budget is \"2 sheep\": "},
           {"idle-timeout = \"60\"\n", ":1: idle-timeout is \"60\": "},
           {"log-level = \"loud\"\n", ":1: log-level is \"loud\": "},
           {"max-calls = 5\n\nmax-calls = 6\n", ":3: max-calls is given in line 1, too; remove one of them"},
           {"max-calls = 5\nmax-calls = 5\n", ":2: max-calls is given in line 1, too"},
           {"token-file = a b\n", ":1: token-file has 2 values; write one, in quotes"},
           {"log-json = true\n[server]\nmax-calls = 5\n", ":2: the section [server] is not known"}}) {
    const TemporaryFile file(text);
    const absl::Status status = parse({"--config", file.path().c_str()}).status();
    EXPECT_REFUSED(kInvalidArgument, "", status) << text;
    EXPECT_EQ(std::string(status.message()).find(file.path() + words), 0u) << status;
    EXPECT_EQ(std::string(status.message()).find('\n'), std::string::npos) << status;
  }
}

TEST(Config, AnErrorInAVariableNamesIt) {
  for (const auto& [name, value, words] : std::vector<std::tuple<const char*, const char*, std::string>>{
           {"CANDELA_MAX_CALLS", "many",
            "CANDELA_MAX_CALLS: max-calls is \"many\": it must be a whole number"},
           {"CANDELA_MAX_CALLS", "0", "CANDELA_MAX_CALLS: max-calls is 0; it must be 1 .. 4096"},
           {"CANDELA_INSECURE", "perhaps",
            "CANDELA_INSECURE: insecure is \"perhaps\": it must be true or false"},
           {"CANDELA_IDLE_TIMEOUT", "60", "CANDELA_IDLE_TIMEOUT: idle-timeout is \"60\": "}}) {
    const Variable variable(name, value);
    const absl::Status status = parse({}).status();
    EXPECT_REFUSED(kInvalidArgument, "", status) << name;
    EXPECT_EQ(std::string(status.message()).find(words), 0u) << status;
  }
}

TEST(Config, TheFileMayListAddressesAsTomlDoes) {
  for (const char* text : {"listen = \"a:1,unix:/tmp/c.sock\"\ninsecure = true\n",
                           "insecure = true\nlisten = [\"a:1\", \"unix:/tmp/c.sock\"]\n"}) {
    const TemporaryFile file(text);
    ASSERT_OK_AND_ASSIGN(const Invocation invocation, parse({"--config", file.path().c_str()}));
    EXPECT_EQ(invocation.config.listen, (std::vector<std::string>{"a:1", "unix:/tmp/c.sock"}));
  }
}

TEST(ListenAddress, BeyondLoopbackNeedsInsecure) {
  for (const char* loopback :
       {"127.0.0.1:50051", "127.9.9.9:0", "localhost:1", "[::1]:65535", "unix:/run/c.sock"}) {
    EXPECT_OK(check_listen_address(loopback, false)) << loopback;
  }
  for (const char* beyond : {"0.0.0.0:1", "[::]:1", "192.168.0.1:1", "example.org:1", "[fe80::1]:1"}) {
    EXPECT_REFUSED(kInvalidArgument, "--insecure", check_listen_address(beyond, false)) << beyond;
    EXPECT_OK(check_listen_address(beyond, true)) << beyond;
  }
}

// A name that only starts like a loopback address belongs to the owner of the domain.
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
  EXPECT_EQ(parse_bytes("2gib").value(), uint64_t{2} << 30);
  EXPECT_EQ(parse_bytes("16777215TiB").value(), uint64_t{16777215} << 40);
  for (const char* bad :
       {"", "GiB", "-1", "1.5GiB", "16777216TiB", "1 GiB", "1GB", "1G", "0x10", "99999999999999999999"}) {
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
