// The command with a running candelad.
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/clock.h"
#include "client/connection.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/service/test_ca.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class WithServer : public ::testing::Test {
 protected:
  void SetUp() override {
    write_small_exr(in_);
    out_ = folder_.path("out.png");
  }
  TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  std::string out_;
};

TEST_F(WithServer, ItGivesTheBytesThatTheEmbeddedOneGives) {
  const ListeningDaemon daemon;
  ASSERT_NE(daemon.address(), "");
  const std::string scene = folder_.path("scene.exr");
  ASSERT_EQ(candela({"sample", scene, "--size", "641x359", "-q"}).code, 0);
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {}, {"--bits", "16", "--curve", "reinhard"}, {"--exposure", "-3", "--bloom-intensity", "0.5"}}) {
    std::vector<std::string> here = with({"render", scene, folder_.path("here.png")}, options);
    std::vector<std::string> there = here;
    there[2] = out_;
    there.insert(there.end(), {"--server", daemon.address()});
    ASSERT_EQ(candela(here).code, 0);
    const Outcome outcome = candela(there);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(read_file(folder_.path("here.png")) == read_file(out_));
  }
}

TEST_F(WithServer, HealthAndInfoAnswer) {
  ListeningDaemon daemon({"--listen", "unix:" + folder_.path("socket")});
  ASSERT_EQ(daemon.address(), "unix:" + folder_.path("socket"));
  const Outcome health = candela({"health", "--server", daemon.address()});
  EXPECT_EQ(health.code, 0) << health.err;
  EXPECT_EQ(health.out, "SERVING\n");
  ASSERT_EQ(candela({"render", in_, out_, "--server", daemon.address()}).code, 0);
  const nlohmann::json info = candela_json({"info", "--server", daemon.address()});
  EXPECT_EQ(info.at("address"), daemon.address());
  EXPECT_EQ(info.at("frames_rendered"), 1);
  EXPECT_GT(info.at("pool").at("misses"), 0);
  daemon.stop();
  EXPECT_EQ(candela({"health", "--server", "unix:" + folder_.path("socket")}).code, 1);
}

TEST_F(WithServer, ItsLimitsHoldForTheFileBeforeItIsRead) {
  const ListeningDaemon daemon({"--max-dimension", "30"});
  const Outcome outcome = candela({"render", in_, out_, "--server", daemon.address()});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_TRUE(says(outcome.err, "the limit is 30 on a side"));
  EXPECT_TRUE(says(outcome.err, in_));
  const ListeningDaemon small({"--max-frame-bytes", "1024"});
  const Outcome bytes = candela({"render", in_, out_, "--server", small.address()});
  EXPECT_EQ(bytes.code, 3);
  EXPECT_TRUE(says(bytes.err, in_));
  EXPECT_EQ(png_facts(out_).width, 0u);
}

#ifndef CANDELA_SANITIZED  // a sanitizer has mappings of its own
TEST_F(WithServer, MemoryThatRunsOutIsAnErrorInOneLine) {
  const ListeningDaemon daemon;
  const std::string scene = folder_.path("scene.pfm");
  ASSERT_EQ(candela({"sample", scene, "--size", "1024x600", "-q"}).code, 0);
  const auto render = [&](const char* mappings) {
    return candela_on_failing_machine("CANDELA_TEST_MAPPINGS", mappings,
                                      {"render", scene, out_, "--server", daemon.address()});
  };
  EXPECT_EQ(render("1").code, 0);  // the image takes its frame's memory
  const Outcome outcome = render("0");
  EXPECT_EQ(outcome.code, 1);
  EXPECT_TRUE(says(outcome.err, "memory")) << outcome.err;
  const Outcome stream = candela_on_failing_machine(
      "CANDELA_TEST_MAPPINGS", "1", {"stream", scene, folder_.path("out"), "--server", daemon.address()});
  EXPECT_EQ(stream.code, 1);
  EXPECT_TRUE(says(stream.err, "out of memory"));
}
#endif

TEST_F(WithServer, AnUnknownTierIsAWrongUseThatListsItsTiers) {
  const ListeningDaemon daemon;
  const Outcome outcome = candela({"render", in_, out_, "--server", daemon.address(), "--tier", "standart"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(says(outcome.err, "did you mean standard?"));
}

// Where the command looks for its server, and what it says if none is there, or something else is.

// `code` is 1 for `candela health`, and 4 for the others.
void expect_failure(const Outcome& outcome, const std::string& words, int code = 4) {
  EXPECT_EQ(outcome.code, code) << outcome.err;
  EXPECT_TRUE(says(outcome.err, words));
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  for (const char* raw : {"ipv4:", "last error", "UNKNOWN", "C-ares", "http2 header", "failed to connect"}) {
    EXPECT_FALSE(says(outcome.err, raw));
  }
}

// Sets CANDELA_SERVER during a test.
class ServerVariable {
 public:
  explicit ServerVariable(const std::string& value) { setenv("CANDELA_SERVER", value.c_str(), 1); }
  ~ServerVariable() { unsetenv("CANDELA_SERVER"); }
};

// Listens on a free port and gives each connection to `talk`, which leaves it open.
class RawServer {
 public:
  using Talk = void (*)(int socket);
  explicit RawServer(Talk talk) : listener_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    EXPECT_EQ(bind(listener_, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(listen(listener_, 8), 0);
    getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this, talk] {
      for (int one = accept(listener_, nullptr, nullptr); one >= 0;
           one = accept(listener_, nullptr, nullptr)) {
        talk(one);
        close(one);
      }
    });
  }
  ~RawServer() {
    shutdown(listener_, SHUT_RDWR);
    thread_.join();
    close(listener_);
  }
  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

 private:
  const int listener_;
  int port_ = 0;
  std::thread thread_;
};

void send_text(int socket, const std::string& text) {
  EXPECT_EQ(send(socket, text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
}

void read_to_end(int socket) {
  char bytes[4096];
  while (recv(socket, bytes, sizeof bytes, 0) > 0) {
  }
}

void speak_http1(int socket) {
  send_text(socket, "HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
}

std::string http2_frame(char type, char flags, char stream, const std::string& body) {
  const char head[] = {0, 0, static_cast<char>(body.size()), type, flags, 0, 0, 0, stream};
  return std::string(head, sizeof head) + body;
}

// Speaks HTTP/2 until the first call. Returns its stream, or 0 if the client ends before.
char accept_http2_call(int socket) {
  send_text(socket, http2_frame(4, 0, 0, "") + http2_frame(4, 1, 0, ""));
  std::string read;
  char bytes[4096];
  size_t at = 24;  // after the client's preface
  while (true) {
    while (read.size() >= at + 9) {
      const auto byte = [&](size_t i) { return static_cast<unsigned char>(read[at + i]); };
      if (byte(3) == 1) return static_cast<char>(byte(8));
      at += 9 + (size_t{byte(0)} << 16 | size_t{byte(1)} << 8 | byte(2));
    }
    const ssize_t count = recv(socket, bytes, sizeof bytes, 0);
    if (count <= 0) return 0;
    read.append(bytes, static_cast<size_t>(count));
  }
}

// Speaks HTTP/2 and answers the first call with this :status, as HPACK writes it.
void answer_http2(int socket, const std::string& status) {
  const char stream = accept_http2_call(socket);
  if (stream == 0) return;
  send_text(socket, http2_frame(1, 5, stream, status));
  read_to_end(socket);
}

// Takes the first call, and answers neither it nor a ping.
void fall_silent(int socket) {
  accept_http2_call(socket);
  read_to_end(socket);
}

TEST(ServerErrors, NothingListens) {
  for (const std::vector<std::string>& command : {std::vector<std::string>{"health"}, {"info"}}) {
    std::vector<std::string> arguments = command;
    arguments.insert(arguments.end(), {"--server", "127.0.0.1:1"});
    expect_failure(
        candela(arguments),
        "cannot reach 127.0.0.1:1: nothing listens there; start one with candelad --listen 127.0.0.1:1, or "
        "name another server",
        command[0] == "health" ? 1 : 4);
  }
  expect_failure(candela({"info", "--server", "unix:/no/such/socket"}), "there is no such socket");
}

TEST(ServerErrors, NoMachineHasTheName) {
  const Outcome outcome = candela({"health", "--server", "no-such-host.invalid:1"});
  // Without a network there may be no answer about the name either.
  expect_failure(
      outcome, says(outcome.err, "no machine") ? "no machine has this name; check the name" : "looked up", 1);
}

TEST(ServerErrors, SomethingElseListens) {
  const RawServer http1(speak_http1);
  expect_failure(candela({"health", "--server", http1.address()}), "it does not speak gRPC; check the port",
                 1);
  const RawServer not_found([](int socket) { answer_http2(socket, "\x8d"); });
  expect_failure(candela({"health", "--server", not_found.address()}),
                 not_found.address() + " is a web server and no candelad (HTTP status 404)", 1);
  const RawServer proxy([](int socket) {
    answer_http2(socket,
                 "\x48\x03"
                 "503");
  });
  expect_failure(candela({"info", "--server", proxy.address()}), "is a proxy that reaches no candelad now");
  const RawServer hangs(read_to_end);
  expect_failure(candela({"health", "--server", hangs.address(), "--timeout", "0.3"}), "no answer from", 1);
  const RawServer closes([](int) {});
  expect_failure(candela({"health", "--server", closes.address()}), "it closed the connection at once", 1);
}

// The rendering calls of the command have no deadline, so a lost server must be noticed without one.
TEST(ServerErrors, AServerThatFallsSilentIsLost) {
  const RawServer server(fall_silent);
  const absl::StatusOr<Connection> connection = Connection::open(server.address());
  EXPECT_REFUSED(kUnavailable, "it no longer answers",
                 connection->server_info(absl::Now() + absl::Minutes(1)));
}

TEST(ServerErrors, TlsAndNoTlsAreToldApart) {
  const TemporaryFolder folder;
  const testing::TestCa ca("Candela test CA");
  const testing::Issued issued = ca.issue("server");
  for (const auto& [name, text] :
       {std::pair("ca.pem", ca.cert()), {"server.pem", issued.cert}, {"server.key", issued.key}}) {
    write_file(folder.path(name), text);
    ASSERT_EQ(chmod(folder.path(name).c_str(), S_IRUSR | S_IWUSR), 0);
  }
  const ListeningDaemon secure(
      {"--tls-cert", folder.path("server.pem"), "--tls-key", folder.path("server.key")});
  expect_failure(candela({"health", "--server", secure.address()}), "speaks TLS and the client did not", 1);
  const ListeningDaemon plain;
  expect_failure(candela({"health", "--server", plain.address(), "--tls-ca", folder.path("ca.pem")}),
                 "does not speak TLS", 1);
}

TEST(ServerErrors, ATokenThatIsNotTakenIsNamedByItsFile) {
  const TemporaryFolder folder;
  for (const auto& [name, token] :
       {std::pair("tokens", "0123456789abcdef\n"), {"token", "fedcba9876543210\n"}}) {
    write_file(folder.path(name), token);
    ASSERT_EQ(chmod(folder.path(name).c_str(), S_IRUSR | S_IWUSR), 0);
  }
  const ListeningDaemon daemon({"--token-file", folder.path("tokens")});
  expect_failure(candela({"info", "--server", daemon.address()}), "this server requires a token");
  expect_failure(candela({"info", "--server", daemon.address(), "--token-file", folder.path("token")}),
                 "does not accept the token in " + folder.path("token"));
}

TEST(ServerVariables, ItStandsForTheOption) {
  const ListeningDaemon daemon;
  ASSERT_NE(daemon.address(), "");
  const TemporaryFolder folder;
  write_small_exr(folder.path("in.exr"));
  {
    const ServerVariable variable(daemon.address() + ",127.0.0.1:1");
    EXPECT_EQ(candela({"health"}).out, "SERVING\n");
    EXPECT_EQ(candela_json({"info"}).at("address"), daemon.address());
    for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
             {"render", folder.path("in.exr"), folder.path("out.png"), "-q"},
             {"stream", folder.path("in.exr"), folder.path("out_%d.png"), "-q"},
             {"meter", folder.path("in.exr")}}) {
      const Outcome outcome = candela(command);
      EXPECT_EQ(outcome.code, 0) << outcome.err;
    }
    EXPECT_EQ(candela_json({"info"}).at("frames_rendered"), 3);
    expect_failure(candela({"info", "--server", "127.0.0.1:1"}), "name another server\n");
    EXPECT_EQ(candela_json({"info", "--device", "0"}).at("address"), "");
  }
  const ServerVariable none("");
  EXPECT_EQ(candela_json({"info"}).at("address"), "");
}

TEST(ServerVariables, ASessionMovesAlongItsList) {
  const ListeningDaemon daemon;
  const TemporaryFolder folder;
  write_small_exr(folder.path("in.exr"));
  const ServerVariable variable("127.0.0.1:1," + daemon.address());
  const Outcome outcome = candela({"stream", folder.path("in.exr"), folder.path("out_%d.png"), "-q"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
}

TEST(ServerVariables, ErrorsSayThatTheAddressIsFromIt) {
  {
    const ServerVariable variable("127.0.0.1:1");
    expect_failure(candela({"info"}), "cannot reach 127.0.0.1:1: nothing listens there");
    expect_failure(candela({"info"}), "(the address is from CANDELA_SERVER)\n");
    expect_failure(candela({"health"}), "(the address is from CANDELA_SERVER)\n", 1);
  }
  for (const auto& [value, words] :
       {std::pair("nowhere:x", "neither HOST:PORT"), {"a:1,,b:2", "CANDELA_SERVER is \"a:1,,b:2\""}}) {
    const ServerVariable variable(value);
    const Outcome outcome = candela({"info"});
    EXPECT_EQ(outcome.code, 2);
    EXPECT_TRUE(says(outcome.err, words) && says(outcome.err, "CANDELA_SERVER"));
  }
}

TEST(Health, AsksWhereCandeladListensByDefault) {
  const Outcome outcome = candela({"health"});
  if (outcome.code == 0) {  // this machine's own candelad answers
    EXPECT_EQ(outcome.out, "SERVING\n");
    return;
  }
  expect_failure(outcome, "127.0.0.1:50051", 1);
  EXPECT_TRUE(says(outcome.err, "(the address is candelad's default; --server names another)"));
}

// The command with a candelad that requires TLS, a client certificate and a token.

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

// The built-in server without Vulkan.

class NoVulkan : public ::testing::Test {
 protected:
  void SetUp() override {
    if (std::filesystem::exists("/dev/dri") || std::filesystem::exists("/dev/nvidiactl")) {
      GTEST_SKIP() << "a GPU may render here";
    }
    ASSERT_EQ(candela({"sample", in_, "--size", "641x359", "-q"}).code, 0);
    // The dynamic linker goes no further than a library that it cannot read.
    std::filesystem::create_directory(folder_.path("lib"));
    write_file(folder_.path("lib/libvulkan.so.1"), "");
  }

  Outcome without_loader(const std::vector<std::string>& arguments) const {
    return candela_in_shell("export LD_LIBRARY_PATH='" + folder_.path("lib") + "'", arguments);
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr"), out_ = folder_.path("out.png");
};

TEST_F(NoVulkan, RendersTheSameBitsWithoutTheLoader) {
  for (const char* const tier : {"draft", "standard", "reference"}) {
    const Outcome rendered = without_loader({"render", in_, out_, "--tier", tier, "-v"});
    ASSERT_EQ(rendered.code, 0) << rendered.err;
    EXPECT_TRUE(says(rendered.out, "host, tier ")) << rendered.out;
    const std::string vulkan = folder_.path("vulkan.png");
    const Outcome other =
        candela({"render", in_, vulkan, "--tier", tier, "--device", "llvmpipe", "--executor", "host", "-q"});
    ASSERT_EQ(other.code, 0) << other.err;
    EXPECT_TRUE(read_file(out_) == read_file(vulkan)) << tier;
  }
  const Outcome info = without_loader({"info"});
  EXPECT_EQ(info.code, 0) << info.err;
  EXPECT_TRUE(says(info.out, "driver     none: there is no Vulkan device")) << info.out;
}

TEST_F(NoVulkan, LoadsNeitherLoaderNorDriver) {
  const std::string log = folder_.path("loaded");
  const Outcome rendered =
      candela_in_shell("export LD_DEBUG=files LD_DEBUG_OUTPUT='" + log + "'", {"render", in_, out_, "-q"});
  ASSERT_EQ(rendered.code, 0) << rendered.err;
  std::string loaded;
  for (const std::string& name : folder_.list()) {
    if (name.starts_with("loaded.")) loaded += read_file(folder_.path(name));
  }
  EXPECT_TRUE(says(loaded, "libOpenEXR"));
  for (const char* const library : {"libvulkan", "libLLVM"}) EXPECT_FALSE(says(loaded, library)) << library;
}

TEST_F(NoVulkan, AnEnvironmentNeedsItAndTheErrorSaysWhatToInstall) {
  const std::string pano = folder_.path("pano.exr");
  ASSERT_EQ(candela({"sample", "--panorama", pano, "--size", "32x16", "-q"}).code, 0);
  for (const std::vector<std::string>& command :
       std::vector<std::vector<std::string>>{{"view", pano, out_, "--size", "8x8"},
                                             {"environment", pano, folder_.path("out.ktx2")},
                                             {"render", in_, out_, "--executor", "device"},
                                             {"render", in_, out_, "--device", "llvmpipe"}}) {
    const Outcome refused = without_loader(command);
    EXPECT_EQ(refused.code, 4) << refused.out;
    EXPECT_TRUE(says(refused.err, "no Vulkan loader found: install Debian's mesa-vulkan-drivers"))
        << refused.err;
  }
  const Outcome refused =
      candela({"view", pano, out_, "--size", "8x8", "--device", "host", "--executor", "auto"});
  EXPECT_EQ(refused.code, 4) << refused.out;
  EXPECT_TRUE(says(refused.err, "without --device host")) << refused.err;
}

}  // namespace
}  // namespace candela
