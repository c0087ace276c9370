// Sessions whose client, server or link fails, is slow or is silent.
#include <arpa/inet.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <memory>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "client/call/raw_call.h"
#include "client/call/retry_schedule.h"
#include "server/server.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

// The server renders nothing from construction until release() or destruction.
class BusyDevice {
 public:
  explicit BusyDevice(Server& server) : server_(server) {
    const absl::Status occupied = server.occupy_device([this] {
      busy_.Notify();
      released_.WaitForNotification();
      left_.Notify();
    });
    EXPECT_TRUE(occupied.ok()) << occupied;
    busy_.WaitForNotification();
  }
  ~BusyDevice() { release(); }

  // Returns false if fewer frames than this wait after a minute.
  bool wait_until_waiting(size_t frames) const {
    const absl::Time until = absl::Now() + absl::Minutes(1);
    while (server_.frames_waiting() < frames && absl::Now() < until) absl::SleepFor(absl::Milliseconds(5));
    return server_.frames_waiting() >= frames;
  }

  void release() {
    if (!released_.HasBeenNotified()) released_.Notify();
    left_.WaitForNotification();
  }

 private:
  const Server& server_;
  absl::Notification busy_, released_, left_;
};

// Sessions that end early: no other client notices, and the server keeps nothing of them.

enum class When { kBeforeOpen, kMidBand, kBetweenFrames, kWhileReading };
enum class Fault { kCancel, kDeadline, kDisconnect, kDrain, kKill };

constexpr const char* kWhenNames[] = {"BeforeOpen", "MidBand", "BetweenFrames", "WhileReading"};
constexpr const char* kFaultNames[] = {"Cancel", "Deadline", "Disconnect", "Drain", "Kill"};

class Faults : public ::testing::TestWithParam<std::tuple<When, Fault>> {
 protected:
  static constexpr absl::Duration kDeadline = absl::Milliseconds(400);

  // The idle timeout is longer than any test, so only the fault can free the session's memory.
  static Config config() {
    Config config = test_config();
    config.idle_timeout = absl::Minutes(5);
    config.drain_timeout = absl::Milliseconds(700);
    return config;
  }

  // Brings the call to the state in which the fault occurs. Returns false if the call ended before.
  static bool reach(When when, StreamClient& client) {
    const WireFrame large = natural(1200, 800);
    switch (when) {
      case When::kBeforeOpen:
        return true;
      case When::kMidBand:
        return client.open("fault") && client.send_header(large, 0, 0) && client.send_rows(large, 0, 200);
      case When::kBetweenFrames: {
        StreamResult result;
        return client.open("fault") && client.send(natural(64, 48), 0, 0) && client.read(result);
      }
      case When::kWhileReading: {
        // The results have 7.7 MB. A client that does not read accepts 64 KB of them.
        v1::Settings settings;
        settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
        return client.open("fault", settings) && client.send(large, 0, 0);
      }
    }
    return false;
  }
};

std::string fault_name(const ::testing::TestParamInfo<std::tuple<When, Fault>>& fault) {
  return std::string(kWhenNames[static_cast<int>(std::get<0>(fault.param))]) +
         kFaultNames[static_cast<int>(std::get<1>(fault.param))];
}

INSTANTIATE_TEST_SUITE_P(Matrix, Faults,
                         ::testing::Combine(::testing::Values(When::kBeforeOpen, When::kMidBand,
                                                              When::kBetweenFrames, When::kWhileReading),
                                            ::testing::Values(Fault::kCancel, Fault::kDeadline,
                                                              Fault::kDisconnect, Fault::kDrain,
                                                              Fault::kKill)),
                         fault_name);

TEST_P(Faults, LeaveNothingBehindAndDisturbNobody) {
  const auto [when, fault] = GetParam();
  const bool reads = when != When::kWhileReading;
  if (fault == Fault::kKill) {
    Daemon daemon({"--listen", "127.0.0.1:0"});
    const std::string address = daemon.wait_until_listening();
    ASSERT_NE(address, "") << daemon.errors();
    StreamClient client(own_channel(address), reads);
    ASSERT_TRUE(reach(when, client));
    absl::SleepFor(absl::Milliseconds(100));
    daemon.signal(SIGKILL);
    EXPECT_EQ(daemon.wait(), -SIGKILL);
    EXPECT_EQ(client.finish().error_code(), grpc::UNAVAILABLE);
    return;
  }
  const std::unique_ptr<Server> server = start_server(config());
  ASSERT_NE(server, nullptr);
  const std::string address = server->addresses().at(0);
  const Connection bystander(server->in_process_channel());
  WireCutter cutter(address);
  {
    const absl::Time deadline = fault == Fault::kDeadline ? absl::Now() + kDeadline : absl::InfiniteFuture();
    StreamClient client(own_channel(fault == Fault::kDisconnect ? cutter.address() : address), reads,
                        deadline);
    const bool reached = reach(when, client);
    ASSERT_TRUE(reached || fault == Fault::kDeadline);
    if (when == When::kWhileReading) absl::SleepFor(absl::Milliseconds(100));  // rendered, and stuck
    EXPECT_OK(bystander.render({}, {.width = 1, .height = 1, .pixels = natural(1, 1).pixels}));
    grpc::StatusCode expected = grpc::CANCELLED;
    switch (fault) {
      case Fault::kCancel:
        client.cancel();
        break;
      case Fault::kDeadline:
        expected = grpc::DEADLINE_EXCEEDED;
        break;
      case Fault::kDisconnect:
        cutter.cut();
        expected = grpc::UNAVAILABLE;
        break;
      default: {
        // If nothing is in flight, the drain ends at once. If a client does not read, it ends at its limit.
        const absl::Time begin = absl::Now();
        server->drain_and_stop();
        EXPECT_LT(absl::Now() - begin, config().idle_timeout);
        const grpc::Status status = client.finish();
        EXPECT_TRUE(status.error_code() == grpc::UNAVAILABLE ||
                    (when == When::kWhileReading && status.error_code() == grpc::CANCELLED))
            << status.error_code() << " " << status.error_message();
        EXPECT_EQ(client.told_to_go_away(), when == When::kMidBand || when == When::kBetweenFrames);
        return;
      }
    }
    const grpc::Status status = client.finish();
    EXPECT_EQ(status.error_code(), expected) << status.error_message();
  }
  EXPECT_TRUE(wait_until_idle(bystander)) << "a session, its place or its memory was not given back";
  EXPECT_OK(bystander.render({}, {.width = 1, .height = 1, .pixels = natural(1, 1).pixels}));
  EXPECT_EQ(server->validation_messages(), 0u);
}

// gRPC misses about one in some hundred resets that follow a connection's last bytes at once.
TEST(StreamFaults, AConnectionThatIsResetIsNoticedLongBeforeItsTimeIsUp) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(5);
  const std::unique_ptr<Server> server = start_server(config);
  const Connection connection(server->in_process_channel());
  const WireFrame frame = natural(640, 480);
  std::vector<std::thread> clients;
  for (int i = 0; i < 3; ++i) {
    clients.emplace_back([&, i] {
      for (int j = 0; j < 300; ++j) {
        WireCutter cutter(server->addresses().at(0));
        StreamClient client(own_channel(cutter.address()));
        client.open(absl::StrCat("reset-", i, "-", j));
        client.send(frame, 0, 0);
        client.send_header(frame, 1, 1);
        cutter.cut();
        EXPECT_FALSE(client.finish().ok());
      }
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_TRUE(wait_until_idle(connection));
}

TEST(StreamFaults, TheFramesOfASessionThatIsGoneAreNotRendered) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(1);
  const std::unique_ptr<Server> server = start_server(config);
  const Connection connection(server->in_process_channel());
  const uint64_t before = connection.server_info()->frames_rendered();
  {
    const BusyDevice device(*server);
    StreamClient client(own_channel(server->addresses().at(0)));
    ASSERT_TRUE(client.open("gone"));
    for (uint64_t i = 0; i < 3; ++i) {
      ASSERT_TRUE(client.send(natural(64, 48), i, static_cast<int64_t>(i)));
    }
    ASSERT_TRUE(device.wait_until_waiting(3));
    client.cancel();
    EXPECT_EQ(client.finish().error_code(), grpc::CANCELLED);
    ASSERT_TRUE(wait_until(connection, [](const auto& info) { return info.sessions() == 0; }));
  }
  EXPECT_OK(connection.render({}, view(natural(16, 16))));
  EXPECT_EQ(connection.server_info()->frames_rendered() - before, 1u);
  EXPECT_TRUE(wait_until_idle(connection));
}

// Together the sessions need more memory than there is, and each holds memory while it waits for more.
TEST(StreamFaults, SessionsWithLookaheadDoNotWaitForEachOthersMemory) {
  Config config = test_config();
  config.memory_budget_bytes = uint64_t{20} << 20;
  config.idle_timeout = absl::Minutes(2);
  const std::unique_ptr<Server> server = start_server(config);
  const std::vector<WireFrame> frames(24, natural(200, 150));
  const absl::Time begin = absl::Now();
  std::vector<std::thread> clients;
  for (int i = 0; i < 3; ++i) {
    clients.emplace_back([&, i] {
      v1::StreamOpen open = open_of(absl::StrCat("ahead-", i));
      open.set_lookahead(16);
      EXPECT_EQ(stream_all(own_channel(server->addresses().at(0)), open, frames).size(), frames.size());
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_LT(absl::Now() - begin, config.idle_timeout);
  EXPECT_TRUE(wait_until_idle(Connection(server->in_process_channel())));
}

TEST(StreamFaults, ADrainAnswersEveryFrameThatWasSentInFull) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(1);
  const std::unique_ptr<Server> server = start_server(config);
  BusyDevice device(*server);
  StreamClient client(own_channel(server->addresses().at(0)));
  ASSERT_TRUE(client.open("drained"));
  const WireFrame frame = natural(64, 48);
  for (uint64_t i = 0; i < 2; ++i) ASSERT_TRUE(client.send(frame, i, static_cast<int64_t>(i)));
  ASSERT_TRUE(client.send_header(frame, 2, 2) && client.send_rows(frame, 0, 40));
  ASSERT_TRUE(device.wait_until_waiting(2));
  std::thread drain([&server] { server->drain_and_stop(); });
  absl::SleepFor(absl::Milliseconds(100));  // the drain begins while both frames wait
  device.release();
  const std::vector<StreamResult> results = client.read_all();
  ASSERT_EQ(results.size(), 2u);
  for (uint64_t i = 0; i < 2; ++i) EXPECT_EQ(results[i].sequence(), i);
  EXPECT_TRUE(client.told_to_go_away());
  EXPECT_EQ(client.finish().error_code(), grpc::UNAVAILABLE);
  drain.join();
}

// Sessions of the client library whose servers die, stop, hang or drain. Every frame's image arrives once and
// in order, and is the same as without the fault.

// Two daemons that know each other's tokens.
class SessionFaults : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string keys = folder_.path("keys");
    write_file(keys, "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n");
    ASSERT_EQ(chmod(keys.c_str(), S_IRUSR), 0);
    for (int i = 0; i < 2; ++i) {
      daemons_.push_back(std::make_unique<Daemon>(
          std::vector<std::string>{"--listen", "127.0.0.1:0", "--resume-keys", keys}));
      addresses_.push_back(daemons_[i]->wait_until_listening());
      ASSERT_NE(addresses_[i], "") << daemons_[i]->errors();
    }
  }

  // The sessions alternate between three kinds.
  SessionOptions options(size_t kind, size_t first_server) const {
    SessionOptions options;
    options.servers = {addresses_[first_server], addresses_[1 - first_server]};
    if (kind % 3 == 1) options.lookahead = 2;
    if (kind % 3 == 2) options.settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
    return options;
  }

  // Runs `count` sessions at once, half of them on the first daemon. Calls `meanwhile` when each has some
  // results and all are still running.
  std::vector<SessionRun> run_sessions(size_t count, const Film& film,
                                       const std::function<void()>& meanwhile) {
    std::vector<SessionRun> runs(count);
    std::vector<std::thread> clients;
    std::atomic<size_t> going = 0;
    absl::Notification all_going;
    for (size_t i = 0; i < count; ++i) {
      clients.emplace_back([&, i] {
        runs[i] = run_session(Session::open(options(i, i < count / 2 ? 0 : 1)), film, [&](size_t results) {
          if (results != kSome) return;
          ++going;
          all_going.WaitForNotification();
        });
      });
    }
    const absl::Time limit = absl::Now() + absl::Minutes(2);
    while (going < count && absl::Now() < limit) absl::SleepFor(absl::Milliseconds(1));
    all_going.Notify();
    absl::SleepFor(absl::Milliseconds(20));
    meanwhile();
    for (std::thread& client : clients) client.join();
    return runs;
  }

  // The undisturbed results of each kind, from the second daemon.
  std::vector<SessionRun> undisturbed(const Film& film) const {
    std::vector<SessionRun> runs;
    for (size_t kind = 0; kind < 3; ++kind)
      runs.push_back(run_session(Session::open(options(kind, 1)), film));
    for (const SessionRun& run : runs) EXPECT_EQ(run.images.size(), film->size()) << run.status;
    return runs;
  }

  // `lose` makes six sessions lose the first daemon. They continue on the second.
  void expect_that_all_go_on(const std::function<void()>& lose) {
    const Film film = make_film(60, 320, 180);
    const std::vector<SessionRun> expected = undisturbed(film);
    const std::vector<SessionRun> runs = run_sessions(6, film, lose);
    for (size_t i = 0; i < runs.size(); ++i) {
      SCOPED_TRACE(absl::StrCat("session ", i));
      EXPECT_OK(runs[i].status);
      EXPECT_TRUE(runs[i].images == expected[i % 3].images);
      EXPECT_EQ(runs[i].stats.resumes, i < 3 ? 1u : 0u) << runs[i].stats.last_loss;
      EXPECT_EQ(runs[i].stats.server, addresses_[1]);
    }
  }

  static constexpr size_t kSome = 6;
  const TemporaryFolder folder_;
  std::vector<std::unique_ptr<Daemon>> daemons_;
  std::vector<std::string> addresses_;
};

TEST_F(SessionFaults, AKilledDaemonCostsSixSessionsNoFrameAndNoBit) {
  expect_that_all_go_on([&] {
    daemons_[0]->signal(SIGKILL);
    EXPECT_EQ(daemons_[0]->wait(), -SIGKILL);
  });
}

TEST_F(SessionFaults, ADrainingDaemonEndsWithZeroAndEveryFrameComesOnce) {
  expect_that_all_go_on([&] {
    daemons_[0]->signal(SIGTERM);
    EXPECT_EQ(daemons_[0]->wait(), 0) << daemons_[0]->errors();
  });
}

// The kernel of the stopped daemon still accepts data.
TEST_F(SessionFaults, AStoppedDaemonIsLeftWhenItGivesNoSignOfLife) {
  const Film film = make_film(30, 320, 180);
  const SessionRun expected = run_session(Session::open(options(0, 1)), film);
  SessionOptions stopped = options(0, 0);
  stopped.ping_interval = absl::Seconds(1);
  const absl::Time begin = absl::Now();
  const SessionRun run = run_session(Session::open(stopped), film, [&](size_t results) {
    if (results == kSome) daemons_[0]->signal(SIGSTOP);
  });
  EXPECT_LT(absl::Now() - begin, stopped.silence_limit);
  EXPECT_OK(run.status);
  EXPECT_TRUE(run.images == expected.images);
  EXPECT_EQ(run.stats.resumes, 1u);
  EXPECT_EQ(run.stats.server, addresses_[1]);
  daemons_[0]->signal(SIGCONT);
  EXPECT_TRUE(wait_until_idle(*Connection::open(addresses_[0]))) << "the session that left was kept";
  daemons_[0]->signal(SIGTERM);
  EXPECT_EQ(daemons_[0]->wait(), 0) << daemons_[0]->errors();
}

// One ping a second on an otherwise idle connection.
TEST_F(SessionFaults, ADaemonTakesThePingsOfASessionThatWaits) {
  SessionOptions waiting = options(0, 0);
  waiting.ping_interval = absl::Seconds(1);
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(waiting));
  absl::SleepFor(absl::Seconds(8));
  EXPECT_EQ(session.stats().resumes, 0u) << session.stats().last_loss;
  const Film film = make_film(3, 64, 48);
  const SessionRun run = run_session(std::move(session), film);
  EXPECT_OK(run.status);
  EXPECT_EQ(run.images.size(), film->size());
  EXPECT_EQ(run.stats.resumes, 0u) << run.stats.last_loss;
}

// Frames that look-ahead holds back are not due.
TEST_F(SessionFaults, LookAheadThatWaitsForFramesIsNoSilence) {
  SessionOptions waiting = options(1, 0);
  waiting.silence_limit = absl::Seconds(2);
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(waiting));
  const Film film = make_film(5, 64, 48);
  for (size_t i = 0; i < film->size(); ++i) {
    if (i == waiting.lookahead) absl::SleepFor(absl::Seconds(4));
    ASSERT_OK(session.submit(frame_of(film, i)));
  }
  session.finish();
  for (size_t i = 0; i < film->size(); ++i) ASSERT_TRUE(session.next_result()->has_value());
  EXPECT_EQ(session.stats().resumes, 0u) << session.stats().last_loss;
}

// A client with a very slow connection. The server ends it in time and keeps nothing of it, and no other
// client notices.

constexpr absl::Duration kIdleTimeout = absl::Milliseconds(500 * kSlower);
constexpr absl::Duration kBounded =
    absl::Seconds(15 * kSlower);  // enough for a loaded machine; the limits are far lower

Config slow_config() {
  Config config = test_config();
  config.idle_timeout = kIdleTimeout;
  return config;
}

enum class Slowed { kBeforeOpen, kBeforeFrame, kMidBand };

class SlowSender : public ::testing::TestWithParam<Slowed> {
 protected:
  // Waits until only the bystander is left. The slow client's connection is still open.
  void expect_only_the_bystander_left() {
    EXPECT_TRUE(wait_until(witness_, [](const auto& info) { return info.sessions() == 1; }));
    repeated_.reset();
    EXPECT_GT(bystander_->answered(), 1u);
    bystander_.reset();
    EXPECT_TRUE(wait_until_idle(witness_)) << "its place or its memory was not given back";
  }

  const std::unique_ptr<Server> server_ = start_server(slow_config());
  const std::string address_ = server_->addresses().at(0);
  const Connection witness_{server_->in_process_channel()};
  std::unique_ptr<Bystander> bystander_ = std::make_unique<Bystander>(address_);
  std::unique_ptr<Repeated> repeated_;

  void SetUp() override {
    bystander_->latency_ms();
    repeated_ = std::make_unique<Repeated>([this] { bystander_->latency_ms(); });
  }
};

std::string slowed_name(const ::testing::TestParamInfo<Slowed>& slowed) {
  constexpr const char* kNames[] = {"BeforeOpen", "BeforeFrame", "MidBand"};
  return kNames[static_cast<int>(slowed.param)];
}

INSTANTIATE_TEST_SUITE_P(When, SlowSender,
                         ::testing::Values(Slowed::kBeforeOpen, Slowed::kBeforeFrame, Slowed::kMidBand),
                         slowed_name);

TEST_P(SlowSender, OfOneByteASecondIsEndedByTheIdleTimeoutAndDisturbsNobody) {
  WireCutter wire(address_);
  StreamClient client(own_channel(wire.address()));
  const WireFrame frame = natural(64, 48);
  ASSERT_TRUE(wait_until(witness_, [](const auto& info) { return info.sessions() == 2; }));
  if (GetParam() != Slowed::kBeforeOpen) {
    StreamResult result;
    ASSERT_TRUE(client.open("slow") && client.send(frame, 0, 0) && client.read(result));
  }
  if (GetParam() == Slowed::kMidBand) {
    // The frame is well under way before the connection becomes slow.
    ASSERT_TRUE(client.send_header(frame, 1, 1) && client.send_rows(frame, 0, 20));
    absl::SleepFor(absl::Milliseconds(50));
  }
  wire.slow_to_server(1);
  const absl::Time begin = absl::Now();
  switch (GetParam()) {
    case Slowed::kBeforeOpen:
      client.open("slow");
      break;
    case Slowed::kBeforeFrame:
      client.send_header(frame, 1, 1);
      break;
    case Slowed::kMidBand:
      client.send_rows(frame, 20, 28);
      break;
  }
  const grpc::Status status = client.finish();
  // A session that is open may be resumed. Its open message may have passed before the line was slow.
  EXPECT_TRUE(status.error_code() == grpc::UNAVAILABLE ||
              (GetParam() == Slowed::kBeforeOpen && status.error_code() == grpc::DEADLINE_EXCEEDED))
      << status.error_message();
  EXPECT_TRUE(says(status.error_message(), "idle timeout"));
  EXPECT_LT(absl::Now() - begin, kBounded);
  expect_only_the_bystander_left();
}

// Each row arrives in time, but a whole frame would take a quarter of a minute, or kSlower times as long.
TEST_F(SlowSender, OfARowNowAndThenIsEndedByTheLimitOfItsFrame) {
  WireCutter wire(address_);
  StreamClient client(own_channel(wire.address()));
  WireFrame frame = natural(1, 100, v1::PIXEL_FORMAT_RGB9E5);
  ASSERT_TRUE(client.open("slow"));
  ASSERT_TRUE(client.send_header(frame, 0, 0));
  ASSERT_TRUE(wait_until(witness_, [](const auto& info) { return info.sessions() == 2; }));
  wire.slow_to_server(150 / kSlower);
  const absl::Time begin = absl::Now();
  for (uint32_t y = 0; y < frame.desc.height && client.send_rows(frame, y, 1); ++y) {
  }
  EXPECT_REFUSED(kDeadlineExceeded, "was not complete", client.finish());
  EXPECT_GT(absl::Now() - begin, 5 * kIdleTimeout);
  EXPECT_LT(absl::Now() - begin, kBounded);
  expect_only_the_bystander_left();
}

// HTTP/2's preface arrives at one byte a second. It takes no session slot, and the server closes the
// connection.
TEST_F(SlowSender, ThatNeverGetsAsFarAsACallIsHungUpOn) {
  const int line = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<uint16_t>(std::stoi(address_.substr(address_.rfind(':') + 1))));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(connect(line, reinterpret_cast<const sockaddr*>(&to), sizeof(to)), 0);
  const absl::Time begin = absl::Now();
  bool hung_up = false;
  for (const char byte : std::string("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n")) {
    send(line, &byte, 1, MSG_NOSIGNAL);
    const absl::Time next = absl::Now() + absl::Seconds(1);
    pollfd answer{line, POLLIN, 0};
    while (!hung_up && poll(&answer, 1,
                            static_cast<int>(absl::ToInt64Milliseconds(
                                std::max(next - absl::Now(), absl::ZeroDuration())))) > 0) {
      char answered[256];
      hung_up = recv(line, answered, sizeof(answered), 0) <= 0;
    }
    if (hung_up) break;
  }
  close(line);
  EXPECT_TRUE(hung_up);
  EXPECT_LT(absl::Now() - begin, kBounded);
  expect_only_the_bystander_left();
}

// Calls that end early, and servers that stop early.

class CallLife : public ServiceTest {
 protected:
  const WireFrame frame_ = natural(640, 480);
};
INSTANTIATE_TEST_SUITE_P(Transport, CallLife, ::testing::Bool(), transport_name);

TEST_P(CallLife, CancelInTheMiddleOfTheBandsGivesTheMemoryBack) {
  OpenCall call(channel());
  call.write(start_of(frame_));
  call.write(band_of(frame_, 0, 100));
  ASSERT_TRUE(wait_until_in_use(connection()));
  call.context.TryCancel();
  EXPECT_EQ(call.finish().error_code(), grpc::CANCELLED);
  EXPECT_TRUE(wait_until_idle(connection()));
}

TEST_P(CallLife, CancelAtAnyMomentLeavesNothingBehind) {
  for (int i = 0; i < 60; ++i) {
    // In process, a call ends for its client before it ends for the server, which counts it until then.
    if (i % 4 == 0) {
      ASSERT_TRUE(wait_until_idle(connection()));
    }
    OpenCall call(channel());
    std::thread canceller([&call, i] {
      absl::SleepFor(absl::Microseconds(300 * i));
      call.context.TryCancel();
    });
    call.write(start_of(frame_));
    call.write(band_of(frame_, 0, 240));
    call.write(band_of(frame_, 240, 240));
    call.stream->WritesDone();
    const grpc::Status status = call.finish();
    canceller.join();
    EXPECT_TRUE(status.ok() || status.error_code() == grpc::CANCELLED) << status.error_message();
  }
  EXPECT_TRUE(wait_until_idle(connection()));
  EXPECT_OK(connection().render({}, view(frame_)));
}

TEST_P(CallLife, ADeadlineEndsTheCall) {
  OpenCall call(channel(), [](grpc::ClientContext& context) {
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(100));
  });
  call.write(start_of(frame_));
  EXPECT_EQ(call.finish().error_code(), grpc::DEADLINE_EXCEEDED);
  EXPECT_TRUE(wait_until_idle(connection()));
}

TEST_P(CallLife, TheClientReportsItsOwnDeadlineInWords) {
  const BusyDevice device(server());  // so that no answer of the server's comes first
  EXPECT_REFUSED(kDeadlineExceeded, "time given",
                 connection().render({}, view(frame_), absl::Now() + absl::Milliseconds(50)));
}

TEST_P(CallLife, AClientThatDoesNotReadItsResultIsCutOffToo) {
  const WireFrame frame = natural(2048, 1024);
  v1::RenderRequest start = start_of(frame);
  // A result of 16 MiB, which is more than flow control allows unread.
  start.mutable_start()->mutable_settings()->set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  OpenCall call(channel());
  call.write(start);
  for (uint32_t y = 0; y < 1024; y += 128) call.write(band_of(frame, y, 128));
  call.stream->WritesDone();
  ASSERT_TRUE(wait_until_in_use(connection()));
  EXPECT_TRUE(wait_until_idle(connection()));
  EXPECT_FALSE(call.finish().ok());
}

TEST(CallLimit, CallsBeyondTheMostAtOnceAreToldToTryAgain) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(1);  // the calls stay open, even on a machine that stands still
  const std::unique_ptr<Server> server = start_server(config);
  const auto channel = own_channel(server->addresses().at(0));
  const Connection connection(channel);
  std::vector<std::unique_ptr<OpenCall>> calls;
  const auto open_another = [&] {
    calls.push_back(std::make_unique<OpenCall>(channel));
    calls.back()->stream->Write(start_of(natural(1, 1)));
  };
  for (uint32_t i = 0; i < config.max_calls; ++i) open_another();
  // They reach the server at different times, and one that comes beside a rendered frame is refused itself.
  absl::Status status;
  const absl::Time give_up = absl::Now() + absl::Seconds(10);
  while (status.ok() && absl::Now() < give_up) {
    status = connection.render({}, view(natural(4, 4))).status();
    if (status.ok()) open_another();
  }
  EXPECT_REFUSED(kUnavailable, "8 calls", status);
  EXPECT_GT(noted_retry_delay(status).value_or(absl::ZeroDuration()), absl::ZeroDuration());
  for (const auto& call : calls) {
    call->context.TryCancel();
    (void)call->finish();
  }
}

TEST(VanishedClient, GivesTheMemoryBackAndHurtsNobody) {
  const std::unique_ptr<Server> server = start_server(test_config());
  const Connection witness(server->in_process_channel());
  const WireFrame frame = natural(320, 480);
  for (uint32_t rows : {0u, 100u, 480u}) {
    WireCutter wire(server->addresses().at(0));
    OpenCall call(grpc::CreateChannel(wire.address(), grpc::InsecureChannelCredentials()));
    call.write(start_of(frame));
    if (rows > 0) {
      call.write(band_of(frame, 0, rows));
      ASSERT_TRUE(wait_until_in_use(witness));
    }
    if (rows == 480) call.stream->WritesDone();
    wire.cut();
    const grpc::Status status = call.finish();
    EXPECT_TRUE(rows == 480 || status.error_code() == grpc::UNAVAILABLE) << status.error_message();
    EXPECT_TRUE(wait_until_idle(witness));
    EXPECT_OK(witness.render({}, view(frame)));
  }
}

TEST(Drain, AFrameInFlightFinishesWhileNewCallsAreRefused) {
  const std::unique_ptr<Server> server = start_server(test_config());
  const auto channel = server->in_process_channel();
  const WireFrame frame = natural(16, 16);
  OpenCall call(channel);
  call.write(start_of(frame));
  call.write(band_of(frame, 0, 1));
  ASSERT_TRUE(wait_until_in_use(Connection(channel)));
  std::thread drain([&server] { server->drain_and_stop(); });
  absl::Status refused;
  while (refused.ok()) refused = Connection(channel).render({}, view(frame)).status();
  EXPECT_REFUSED(kUnavailable, "draining", refused);
  EXPECT_TRUE(absl::IsUnavailable(Connection(channel).health()));
  call.write(band_of(frame, 1, 15));
  call.stream->WritesDone();
  EXPECT_OK(call.finish());
  drain.join();
}

TEST(Drain, CallsThatOutlastTheDrainTimeoutAreCancelled) {
  Config config = test_config();
  config.drain_timeout = absl::Milliseconds(100);
  config.idle_timeout = absl::Minutes(1);
  const std::unique_ptr<Server> server = start_server(config);
  const auto channel = server->in_process_channel();
  OpenCall call(channel);
  const WireFrame frame = natural(16, 16);
  call.write(start_of(frame));
  call.write(band_of(frame, 0, 1));
  ASSERT_TRUE(wait_until_in_use(Connection(channel)));
  const absl::Time start = absl::Now();
  server->drain_and_stop();
  EXPECT_LT(absl::Now() - start, config.idle_timeout);
  EXPECT_FALSE(call.finish().ok());
}

// gRPC calls an answer done once it is written, and this one is on its way for a second longer.
TEST(Drain, AClientOnASlowConnectionGetsAllOfItsAnswer) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(1);
  const std::unique_ptr<Server> server = start_server(config);
  const Connection witness(server->in_process_channel());
  WireCutter wire(server->addresses().at(0));
  wire.slow_to_client(60e3);
  const WireFrame frame = natural(160, 160);
  OpenCall call(own_channel(wire.address()));
  call.write(start_of(frame));
  call.write(band_of(frame, 0, 1));
  ASSERT_TRUE(wait_until_in_use(witness));
  std::thread drain([&] {
    server->drain_and_stop();
    EXPECT_GE(wire.bytes_to_client(), 160u * 160 * 4);
  });
  while (witness.render({}, view(natural(1, 1))).ok()) {
  }
  call.write(band_of(frame, 1, 159));
  call.stream->WritesDone();
  EXPECT_OK(call.finish());
  drain.join();
}

// In the same process, a band is the server's memory. It stays valid while anybody holds it.
TEST(Drain, ABandOutlivesTheServerThatSentIt) {
  std::unique_ptr<Server> server = start_server(test_config());
  const WireFrame frame = flat(64, 64, {1, 1, 1, 1});
  const auto channel = server->in_process_channel();
  ASSERT_OK_AND_ASSIGN(const RenderResult expected, Connection(channel).render({}, view(frame)));
  grpc::ByteBuffer band;
  {
    RawCall call(channel, "/candela.v1.RenderService/Render", absl::InfiniteFuture());
    for (const v1::RenderRequest& request : {start_of(frame), band_of(frame, 0, 64)}) {
      const grpc::Slice bytes(request.SerializeAsString());
      ASSERT_TRUE(call.write(grpc::ByteBuffer(&bytes, 1)));
    }
    ASSERT_TRUE(call.half_close());
    ASSERT_TRUE(call.read(band));
    ASSERT_TRUE(call.read(band));
    ASSERT_OK(call.finish());
  }
  server.reset();
  std::vector<grpc::Slice> slices;
  ASSERT_OK(band.Dump(&slices));
  const grpc::Slice& pixels = slices.back();
  EXPECT_EQ(std::string(pixels.begin(), pixels.end()),
            std::string(reinterpret_cast<const char*>(expected.data.get()), expected.bytes));
}

}  // namespace
}  // namespace candela::testing
