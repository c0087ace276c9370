#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "candela/v1/render.grpc.pb.h"
#include "client/call/raw_call.h"
#include "client/connection.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/scenes.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

FrameView view(const WireFrame& frame) {
  return {frame.desc.width, frame.desc.height, static_cast<v1::PixelFormat>(frame.desc.format), frame.pixels,
          0};
}

// A call of Render that has memory, and of whose frame a half is missing.
std::unique_ptr<RawCall> half_a_call(const std::string& address) {
  auto call = std::make_unique<RawCall>(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()),
                                        "/candela.v1.RenderService/Render", absl::InfiniteFuture());
  v1::RenderRequest start;
  start.mutable_start()->mutable_frame()->set_width(1);
  start.mutable_start()->mutable_frame()->set_height(2);
  start.mutable_start()->mutable_frame()->set_format(v1::PIXEL_FORMAT_RGBA16F);
  v1::RenderRequest half;
  half.mutable_band()->set_pixels(std::string(8, '\0'));
  for (const v1::RenderRequest* message : {&start, &half}) {
    const grpc::Slice bytes(message->SerializeAsString());
    EXPECT_TRUE(call->write(grpc::ByteBuffer(&bytes, 1)));
  }
  const Connection connection = *Connection::open(address);
  while (connection.server_info()->pool().bytes_in_use() == 0) absl::SleepFor(absl::Milliseconds(5));
  return call;
}

TEST(Candelad, RendersOverTcpAndEndsWithZeroOnSigterm) {
  Daemon daemon({"--listen", "127.0.0.1:0"});
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  ASSERT_OK_AND_ASSIGN(const Connection connection, Connection::open(address));
  EXPECT_OK(connection.health());
  EXPECT_OK(connection.render({}, view(natural(33, 9))));
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(), 0) << daemon.errors();
}

TEST(Candelad, RendersOverAUnixSocket) {
  const TemporaryFolder folder;
  const std::string address = "unix:" + folder.path("candelad.sock");
  Daemon daemon({"--listen", address});
  ASSERT_EQ(daemon.wait_until_listening(), address) << daemon.errors();
  EXPECT_OK(Connection::open(address)->render({}, view(natural(5, 5))));
  daemon.signal(SIGINT);
  EXPECT_EQ(daemon.wait(), 0) << daemon.errors();
}

// Every call is answered in full or ends with UNAVAILABLE.
TEST(Candelad, SigtermUnderLoadEndsWithZeroAndTearsNoFrame) {
  Daemon daemon({"--listen", "127.0.0.1:0"});
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  std::unique_ptr<RawCall> in_flight = half_a_call(address);  // at the signal, however the others are timed
  std::atomic<int> rendered = 0;
  std::vector<std::thread> clients;
  for (uint32_t c = 0; c < 4; ++c) {
    clients.emplace_back([&, c] {
      const Connection connection = *Connection::open(address);
      const WireFrame frame = natural(320 + c, 240);
      absl::Status status;
      while (status.ok()) {
        status = connection.render({}, view(frame)).status();
        if (status.ok()) ++rendered;
      }
      EXPECT_REFUSED(kUnavailable, "", status);
      EXPECT_FALSE(says(status.message(), "lost the server"));
    });
  }
  while (rendered < 8) absl::SleepFor(absl::Milliseconds(5));
  daemon.signal(SIGTERM);
  while (Connection::open(address)->health().ok()) absl::SleepFor(absl::Milliseconds(1));
  in_flight.reset();
  EXPECT_EQ(daemon.wait(), 0) << daemon.errors();
  for (std::thread& client : clients) client.join();
}

TEST(Candelad, ASecondSignalEndsItAtOnce) {
  Daemon daemon({"--listen", "127.0.0.1:0", "--drain-timeout", "1h", "--idle-timeout", "1h"});
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  const std::unique_ptr<RawCall> stuck = half_a_call(address);  // keeps it draining
  const Connection connection = *Connection::open(address);
  daemon.signal(SIGTERM);
  while (connection.health().ok()) absl::SleepFor(absl::Milliseconds(5));
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(), 1) << daemon.errors();
}

TEST(Candelad, AnAddressInUseEndsWithOneLineThatSaysSo) {
  Daemon first({"--listen", "127.0.0.1:0"});
  const std::string address = first.wait_until_listening();
  ASSERT_NE(address, "");
  Daemon second({"--listen", address});
  EXPECT_EQ(second.wait(), 1);
  const std::string errors = second.errors();
  EXPECT_EQ(errors.rfind("candelad: cannot listen on " + address, 0), 0u) << errors;
  EXPECT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1) << errors;
}

TEST(Candelad, ASocketThatIsServedIsNotTakenAway) {
  const TemporaryFolder folder;
  const std::string path = folder.path("candelad.sock");
  Daemon first({"--listen", "unix:" + path});
  ASSERT_NE(first.wait_until_listening(), "");
  Daemon second({"--listen", "unix:" + path});
  EXPECT_EQ(second.wait(), 1);
  EXPECT_TRUE(says(second.errors(), "in use"));
  EXPECT_EQ(access(path.c_str(), F_OK), 0) << "the first one's socket is gone";
}

TEST(Candelad, AFileThatIsNoSocketIsNotTakenAway) {
  const TemporaryFolder folder;
  const std::string path = folder.path("file");
  write_file(path, "");
  Daemon daemon({"--listen", "unix:" + path});
  EXPECT_EQ(daemon.wait(), 1);
  EXPECT_TRUE(says(daemon.errors(), "not a socket"));
  EXPECT_EQ(access(path.c_str(), F_OK), 0) << "the file is gone";
}

TEST(Candelad, BadOptionsEndWithTwoAndOneLine) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"--listen", "0.0.0.0:1"},
                                             {"--max-calls", "0"},
                                             {"--listen", ","},
                                             {"--nonsense"},
                                             {"--config", "/no/such/file"}}) {
    Daemon daemon(arguments);
    EXPECT_EQ(daemon.wait(), 2);
    const std::string errors = daemon.errors();
    EXPECT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1) << errors;
  }
}

TEST(Candelad, AFileThatCannotBeReadIsNotTakenForAnEmptyOne) {
  const char* const unreadable = "/proc/self/mem";  // reading it fails, because nothing is at address 0
  Daemon daemon({"--config", unreadable});
  EXPECT_EQ(daemon.wait(), 2);
  const std::string words =
      absl::StrFormat("candelad: --config: cannot read %s: Input/output error", unreadable);
  EXPECT_EQ(daemon.errors().rfind(words, 0), 0u) << daemon.errors();
}

TEST(Candelad, KeysThatCannotBeUsedEndWithOneAndOneLine) {
  Daemon daemon({"--resume-keys", "/no/such/keys"});
  EXPECT_EQ(daemon.wait(), 1);
  const std::string errors = daemon.errors();
  EXPECT_EQ(errors.rfind("candelad: resume-keys: cannot read /no/such/keys", 0), 0u) << errors;
  EXPECT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1) << errors;
}

TEST(Candelad, ADeviceThatIsLostAgainAndAgainEndsItWithOne) {
  Daemon daemon({"--listen", "127.0.0.1:0", "--pre-drain", "10m"}, LOSING_CANDELAD);
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  const Connection connection = *Connection::open(address);
  for (int i = 0; i < 4; ++i) {
    EXPECT_TRUE(absl::IsUnavailable(connection.render({}, view(natural(8, 8))).status()));
  }
  EXPECT_EQ(daemon.wait(), 1);
  EXPECT_TRUE(says(daemon.errors(), "device is lost again and again"));
}

#ifndef CANDELA_SANITIZED  // a sanitizer wants to be loaded first
Daemon daemon_with(const char* preloaded, const std::vector<std::string>& arguments) {
  setenv("LD_PRELOAD", preloaded, 1);
  const absl::Cleanup unset = [] { unsetenv("LD_PRELOAD"); };
  return Daemon(arguments);
}

TEST(Candelad, ADeviceThatRendersWronglyIsNotServed) {
  Daemon daemon = daemon_with(WRONG_DRIVER, {"--listen", "127.0.0.1:0", "--executor", "device"});
  ASSERT_EQ(daemon.wait_until_listening(), "");
  EXPECT_EQ(daemon.wait(), 1);
  EXPECT_TRUE(says(daemon.errors(), "this device or its driver computes wrongly"));
}

// gRPC has a thread that goes on for up to 10 s after a write that had to wait. With many processors it does
// so nearly always.
TEST(Candelad, EndsSoonAfterLargeAnswers) {
  const TemporaryFolder folder;
  Daemon daemon = daemon_with(MANY_CORES, {"--listen", "unix:" + folder.path("door")});
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  {
    ASSERT_OK_AND_ASSIGN(const Connection connection, Connection::open(address));
    for (int i = 0; i < 3; ++i) EXPECT_OK(connection.render({}, view(natural(1500, 900))));
  }
  const absl::Time begin = absl::Now();
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(), 0) << daemon.errors();
  EXPECT_LT(absl::Now() - begin, absl::Seconds(4));
}
#endif

TEST(Candelad, AnUnknownDeviceEndsWithOneAndNamesThoseThereAre) {
  Daemon daemon({"--device", "no such device"});
  EXPECT_EQ(daemon.wait(), 1);
  EXPECT_TRUE(says(daemon.errors(), "no such device"));
}

TEST(Candelad, JsonLogsAreOneObjectALine) {
  Daemon daemon({"--listen", "127.0.0.1:0", "--log-json"});
  const std::string address = daemon.wait_until_listening();
  v1::Settings settings;
  settings.set_tier("\"quoted\"\nand more");
  EXPECT_FALSE(Connection::open(address)->render(settings, view(natural(2, 2))).ok());
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(), 0);
  std::istringstream lines(daemon.errors());
  int count = 0;
  for (std::string line; std::getline(lines, line); ++count) {
    const nlohmann::json event = nlohmann::json::parse(line, nullptr, false);
    ASSERT_TRUE(event.is_object()) << line;
    EXPECT_TRUE(event.contains("time") && event.contains("level") && event.contains("event")) << line;
  }
  EXPECT_GE(count, 4);  // serving, the call, draining, stopped
}

// The lines of a log in JSON whose event is `event`.
std::vector<nlohmann::json> events(const std::string& log, const std::string& event) {
  std::vector<nlohmann::json> found;
  std::istringstream lines(log);
  for (std::string line; std::getline(lines, line);) {
    nlohmann::json one = nlohmann::json::parse(line, nullptr, false);
    if (one.is_object() && one.value("event", "") == event) found.push_back(std::move(one));
  }
  return found;
}

// Runs a session whose second frame is refused for a bad pixel, as a proxy forwards it for `client`.
void stream_a_bad_frame(const std::shared_ptr<grpc::Channel>& channel, const std::string& client) {
  grpc::ClientContext context;
  context.AddMetadata("x-forwarded-for", client);
  const auto stub = v1::RenderService::NewStub(channel);
  const auto stream = stub->Stream(&context);
  v1::StreamRequest open;
  open.mutable_open()->set_session("shot-7");
  open.mutable_open()->mutable_settings()->set_bad_values(v1::BAD_VALUES_REJECT);
  stream->Write(open);
  for (uint64_t i = 0; i < 2; ++i) {
    WireFrame frame = natural(16, 8);
    const uint16_t nan = 0x7e00;
    if (i == 1) std::memcpy(frame.pixels.data(), &nan, sizeof nan);
    v1::StreamRequest header, band;
    header.mutable_frame()->set_sequence(40 + i);
    header.mutable_frame()->set_width(frame.desc.width);
    header.mutable_frame()->set_height(frame.desc.height);
    header.mutable_frame()->set_format(frame.desc.format);
    header.mutable_frame()->set_media_time_ns(static_cast<int64_t>(i));
    band.mutable_band()->set_pixels(frame.pixels.data(), frame.pixels.size());
    stream->Write(header);
    stream->Write(band);
  }
  stream->WritesDone();
  v1::StreamResponse response;
  bool failed = false;
  while (stream->Read(&response)) failed = failed || response.has_failure();
  EXPECT_TRUE(failed);
  EXPECT_OK(stream->Finish());
}

// Behind a proxy, gRPC's peer is the proxy.
TEST(Candelad, TheLogNamesSessionSequenceAndClientOfWhatFails) {
  const TemporaryFolder folder;
  const std::string socket = "unix:" + folder.path("candelad.sock");
  Daemon daemon({"--listen", socket + ",127.0.0.1:0", "--log-json"});
  const std::string both = daemon.wait_until_listening();
  ASSERT_NE(both, "") << daemon.errors();
  const std::string tcp = both.substr(both.find(' ') + 1);
  for (const std::string& address : {socket, tcp}) {
    stream_a_bad_frame(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()),
                       "198.51.100.1, 203.0.113.9");
  }
  v1::Settings settings;
  settings.set_tier("none");
  EXPECT_FALSE(Connection::open(socket)->render(settings, view(natural(2, 2))).ok());
  daemon.signal(SIGTERM);
  ASSERT_EQ(daemon.wait(), 0) << daemon.errors();
  const std::vector<std::string> clients = {"203.0.113.9", "127.0.0.1"};
  const std::vector<nlohmann::json> opened = events(daemon.errors(), "session opened"),
                                    failed = events(daemon.errors(), "frame failed"),
                                    ended = events(daemon.errors(), "session ended"),
                                    rendered = events(daemon.errors(), "render call ended");
  ASSERT_TRUE(opened.size() == 2 && failed.size() == 2 && ended.size() == 2 && rendered.size() == 1)
      << daemon.errors();
  for (size_t i = 0; i < clients.size(); ++i) {
    for (const nlohmann::json& event : {opened[i], failed[i], ended[i]}) {
      EXPECT_EQ(event.value("session", ""), "shot-7") << event;
      EXPECT_EQ(event.value("peer", ""), clients[i]) << event;
    }
    EXPECT_EQ(failed[i].value("sequence", 0), 41) << failed[i];
    EXPECT_EQ(failed[i].value("status", ""), "INVALID_ARGUMENT") << failed[i];
  }
  EXPECT_EQ(rendered[0].value("peer", ""), "local") << rendered[0];
}

TEST(Candelad, TheLogNamesTheClientOfAConnectionThatIsRefused) {
  Daemon daemon({"--listen", "127.0.0.1:0", "--log-json", "--max-connections", "1"});
  const std::string address = daemon.wait_until_listening();
  ASSERT_NE(address, "") << daemon.errors();
  std::vector<std::shared_ptr<grpc::Channel>> channels;
  for (int i = 0; i < 3; ++i) {
    grpc::ChannelArguments own;
    own.SetInt("test-channel", i);  // channels with the same arguments share a connection
    channels.push_back(grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), own));
    channels.back()->WaitForConnected(std::chrono::system_clock::now() + std::chrono::seconds(2));
  }
  daemon.signal(SIGTERM);
  ASSERT_EQ(daemon.wait(), 0) << daemon.errors();
  const std::vector<nlohmann::json> refused = events(daemon.errors(), "connection refused");
  ASSERT_FALSE(refused.empty()) << daemon.errors();
  EXPECT_EQ(refused[0].value("peer", ""), "127.0.0.1") << refused[0];
}

}  // namespace
}  // namespace candela::testing
