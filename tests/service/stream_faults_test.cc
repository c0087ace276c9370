// Sessions that end before their time, and limits that are run into: nobody else notices, and nothing stays
// behind.
#include <csignal>
#include <thread>
#include <tuple>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "tests/service/busy_device.h"
#include "tests/service/service_fixture.h"
#include "tests/service/stream_client.h"
#include "tests/service/wire_cutter.h"
#include "tests/support/daemon.h"

namespace candela::testing {
namespace {

// The matrix.

enum class When { kBeforeOpen, kMidBand, kBetweenFrames, kWhileReading };
enum class Fault { kCancel, kDeadline, kDisconnect, kDrain, kKill };

constexpr const char* kWhenNames[] = {"BeforeOpen", "MidBand", "BetweenFrames", "WhileReading"};
constexpr const char* kFaultNames[] = {"Cancel", "Deadline", "Disconnect", "Drain", "Kill"};

class Faults : public ::testing::TestWithParam<std::tuple<When, Fault>> {
 protected:
  static constexpr absl::Duration kDeadline = absl::Milliseconds(400);

  // Longer than any test takes: what is given back is given back by the fault.
  static Config config() {
    Config config = test_config();
    config.idle_timeout = absl::Minutes(5);
    config.drain_timeout = absl::Milliseconds(700);
    return config;
  }

  // To the state that the fault meets. False: the call ended on the way.
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
        // 7.7 MB of results, of which a client that does not read lets in 64 KB.
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
    EXPECT_TRUE(bystander.render({}, {.width = 1, .height = 1, .pixels = natural(1, 1).pixels}).ok());
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
        // With nothing in flight it ends by itself, and with a client that does not read by the drain's own
        // limit.
        const absl::Time begin = absl::Now();
        server->drain_and_stop();
        EXPECT_LT(absl::Now() - begin, absl::Seconds(10));
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
  EXPECT_TRUE(bystander.render({}, {.width = 1, .height = 1, .pixels = natural(1, 1).pixels}).ok());
  EXPECT_EQ(server->validation_messages(), 0u);
}

// A reset right behind a connection's last bytes is one in some hundred that gRPC does not hear of.
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

// Frames that wait for their turn.

TEST(StreamFaults, TheFramesOfASessionThatIsGoneAreNotRendered) {
  const std::unique_ptr<Server> server = start_server(test_config());
  const Connection connection(server->in_process_channel());
  const uint64_t before = connection.server_info()->frames_rendered();
  BusyDevice device(connection);
  {
    StreamClient client(own_channel(server->addresses().at(0)));
    ASSERT_TRUE(client.open("gone"));
    for (uint64_t i = 0; i < 3; ++i) {
      ASSERT_TRUE(client.send(natural(64, 48), i, static_cast<int64_t>(i)));
    }
    absl::SleepFor(absl::Milliseconds(100));
    client.cancel();
    EXPECT_EQ(client.finish().error_code(), grpc::CANCELLED);
    ASSERT_TRUE(wait_until(connection, [](const auto& info) { return info.sessions() == 0; }));
    ASSERT_TRUE(device.busy()) << "nothing waited";
  }
  device.wait();
  EXPECT_TRUE(connection.render({}, view(natural(16, 16))).ok());
  EXPECT_EQ(connection.server_info()->frames_rendered() - before, 2u);
  EXPECT_TRUE(wait_until_idle(connection));
}

// Together they want more memory than there is, and each holds what waits for more.
TEST(StreamFaults, SessionsWithLookaheadDoNotWaitForEachOthersMemory) {
  Config config = test_config();
  config.memory_budget_bytes = uint64_t{20} << 20;
  config.idle_timeout = absl::Seconds(20);
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
  const std::unique_ptr<Server> server = start_server(test_config());
  const Connection connection(server->in_process_channel());
  BusyDevice device(connection);
  StreamClient client(own_channel(server->addresses().at(0)));
  ASSERT_TRUE(client.open("drained"));
  const WireFrame frame = natural(64, 48);
  for (uint64_t i = 0; i < 2; ++i) ASSERT_TRUE(client.send(frame, i, static_cast<int64_t>(i)));
  ASSERT_TRUE(client.send_header(frame, 2, 2) && client.send_rows(frame, 0, 40));
  absl::SleepFor(absl::Milliseconds(100));
  ASSERT_TRUE(device.busy()) << "nothing waited";
  std::thread drain([&server] { server->drain_and_stop(); });
  const std::vector<StreamResult> results = client.read_all();
  ASSERT_EQ(results.size(), 2u);
  for (uint64_t i = 0; i < 2; ++i) EXPECT_EQ(results[i].sequence(), i);
  EXPECT_TRUE(client.told_to_go_away());
  EXPECT_EQ(client.finish().error_code(), grpc::UNAVAILABLE);
  device.wait();
  drain.join();
}

// Limits.

class StreamLimits : public ServiceTest {
 protected:
  // What the server says to these messages, its place given back.
  template <typename Say>
  static grpc::Status end_of(const Say& say) {
    StreamClient client(channel());
    say(client);
    client.half_close();
    grpc::Status status = client.finish();
    EXPECT_TRUE(wait_until_idle(connection()));
    return status;
  }
  static v1::StreamOpen opening() { return open_of("limits"); }
};
INSTANTIATE_TEST_SUITE_P(Transport, StreamLimits, ::testing::Bool(), transport_name);

#define EXPECT_REFUSED(status, code, words)                                                       \
  do {                                                                                            \
    const grpc::Status refused = (status);                                                        \
    EXPECT_EQ(refused.error_code(), code) << refused.error_message();                             \
    EXPECT_NE(refused.error_message().find(words), std::string::npos) << refused.error_message(); \
  } while (false)

TEST_P(StreamLimits, WhatIsNoSessionIsRefusedByName) {
  const WireFrame frame = natural(16, 16);
  EXPECT_REFUSED(end_of([](StreamClient&) {}), grpc::INVALID_ARGUMENT, "half-closed before its open");
  EXPECT_REFUSED(end_of([&](StreamClient& c) { c.send_header(frame, 0, 0); }), grpc::INVALID_ARGUMENT,
                 "`open`");
  EXPECT_REFUSED(end_of([&](StreamClient& c) { c.open("sp ace"); }), grpc::INVALID_ARGUMENT, "open.session");
  EXPECT_REFUSED(end_of([&](StreamClient& c) { c.open(""); }), grpc::INVALID_ARGUMENT, "open.session");
  EXPECT_REFUSED(end_of([&](StreamClient& c) { c.open(std::string(65, 'a')); }), grpc::INVALID_ARGUMENT,
                 "65 bytes");
  const auto open_with = [](auto set) {
    v1::StreamOpen open = opening();
    set(open);
    return end_of([&](StreamClient& c) { c.open(open); });
  };
  EXPECT_REFUSED(open_with([](auto& o) { o.set_lookahead(17); }), grpc::INVALID_ARGUMENT,
                 "open.lookahead is 17");
  EXPECT_REFUSED(open_with([](auto& o) { o.set_cut_threshold_ev(NAN); }), grpc::INVALID_ARGUMENT,
                 "cut_threshold_ev");
  EXPECT_REFUSED(open_with([](auto& o) { o.set_jpeg_quality(101); }), grpc::INVALID_ARGUMENT,
                 "jpeg_quality is 101");
  EXPECT_REFUSED(open_with([](auto& o) { o.set_encoding(static_cast<v1::Encoding>(9)); }),
                 grpc::INVALID_ARGUMENT, "encoding is 9");
  EXPECT_REFUSED(open_with([](auto& o) {
                   o.set_encoding(v1::ENCODING_JPEG);
                   o.mutable_settings()->set_output_format(v1::OUTPUT_FORMAT_RGBA16);
                 }),
                 grpc::INVALID_ARGUMENT, "JPEG");
}

TEST_P(StreamLimits, BandsThatDoNotTileTheirFrameAreRefused) {
  const WireFrame frame = natural(16, 16);
  const auto with = [&](auto say) {
    return end_of([&](StreamClient& c) {
      c.open(opening());
      say(c);
    });
  };
  EXPECT_REFUSED(with([&](StreamClient& c) { c.send_rows(frame, 0, 4); }), grpc::INVALID_ARGUMENT,
                 "send `frame`");
  EXPECT_REFUSED(with([&](StreamClient& c) {
                   c.send_header(frame, 0, 0);
                   c.send_rows(frame, 0, 15);
                 }),
                 grpc::INVALID_ARGUMENT, "15 of 16 rows");
  EXPECT_REFUSED(with([&](StreamClient& c) {
                   c.send(frame, 0, 0);
                   c.send_rows(frame, 0, 1);
                 }),
                 grpc::INVALID_ARGUMENT, "every row");
  EXPECT_REFUSED(with([&](StreamClient& c) {
                   c.send_header(frame, 0, 0);
                   c.send_rows(frame, 0, 8);
                   c.send_rows(frame, 7, 8);
                 }),
                 grpc::INVALID_ARGUMENT, "begins at row 7 and row 8 is next");
  EXPECT_REFUSED(with([&](StreamClient& c) {
                   c.send_header(frame, 0, 0);
                   c.send_header(frame, 1, 1);
                 }),
                 grpc::INVALID_ARGUMENT, "no band where one is due");
}

TEST_P(StreamLimits, DeclaredSizesAreRefusedBeforeAnyPixel) {
  WireFrame frame = natural(1, 1);
  const auto declared = [&](uint32_t width, uint32_t height) {
    frame.desc.width = width;
    frame.desc.height = height;
    return end_of([&](StreamClient& c) {
      c.open(opening());
      c.send_header(frame, 0, 0);
    });
  };
  EXPECT_REFUSED(declared(0xffffffffu, 0xffffffffu), grpc::RESOURCE_EXHAUSTED, "4294967295");
  EXPECT_REFUSED(declared(16384, 16384), grpc::RESOURCE_EXHAUSTED, "2147483648 bytes");
  EXPECT_REFUSED(declared(0, 5), grpc::INVALID_ARGUMENT, "0x5");
}

TEST_P(StreamLimits, NumbersAndTimesThatRunBackwardsAreRefused) {
  const WireFrame frame = natural(16, 16);
  const auto pair = [&](uint64_t sequence, int64_t time) {
    return end_of([&](StreamClient& c) {
      c.open(opening());
      c.send(frame, 5, 1000);
      c.send(frame, sequence, time);
    });
  };
  EXPECT_REFUSED(pair(4, 1000), grpc::INVALID_ARGUMENT, "frame.sequence is 4 after 5");
  EXPECT_REFUSED(pair(6, 999), grpc::INVALID_ARGUMENT, "frame.media_time_ns is 999 after 1000");
  EXPECT_REFUSED(end_of([&](StreamClient& c) {
                   c.open(opening());
                   c.send(frame, 5, 1000);
                   c.change(5, {});
                 }),
                 grpc::INVALID_ARGUMENT, "change.from_sequence is 5");
  EXPECT_REFUSED(end_of([&](StreamClient& c) {
                   c.open(opening());
                   for (uint64_t i = 1; i <= v1::kMaxPendingChanges + 1; ++i) c.change(i, {});
                 }),
                 grpc::INVALID_ARGUMENT, "16 changes");
}

TEST_P(StreamLimits, ASessionPastTheCapIsToldToComeBack) {
  std::vector<std::unique_ptr<StreamClient>> clients;
  for (uint32_t i = 0; i < test_config().max_sessions; ++i) {
    clients.push_back(std::make_unique<StreamClient>(channel()));
    ASSERT_TRUE(clients.back()->open("s" + std::to_string(i)));
    StreamResult result;
    clients.back()->send(natural(4, 4), 0, 0);
    ASSERT_TRUE(clients.back()->read(result));
  }
  StreamClient late(channel());
  late.open("late");
  EXPECT_REFUSED(late.finish(), grpc::UNAVAILABLE, "sessions, which is its limit");
  clients.pop_back();
  const absl::Time limit = absl::Now() + absl::Seconds(5);
  grpc::Status status;
  do {
    StreamClient again(channel());
    again.open("again");
    again.half_close();
    status = again.finish();
  } while (!status.ok() && absl::Now() < limit);
  EXPECT_TRUE(status.ok()) << status.error_message();
}

TEST_P(StreamLimits, ALookaheadThatCanNeverFitIsRefused) {
  v1::StreamOpen open = opening();
  open.set_lookahead(16);
  WireFrame frame = natural(1, 1);
  frame.desc.width = 1920;
  frame.desc.height = 1080;
  EXPECT_REFUSED(end_of([&](StreamClient& c) {
                   c.open(open);
                   c.send_header(frame, 0, 0);
                 }),
                 grpc::RESOURCE_EXHAUSTED, "look-ahead of 16 frames of 1920x1080");
}

// What came whole is answered before the refusal of what came after it.
TEST_P(StreamLimits, ARefusalComesAfterTheResultsOfWhatCameBefore) {
  StreamClient client(channel());
  ASSERT_TRUE(client.open(opening()));
  ASSERT_TRUE(client.send(natural(1200, 800), 0, 0));
  WireFrame huge = natural(1, 1);
  huge.desc.width = 1u << 20;
  client.send_header(huge, 1, 1);
  StreamResult result;
  ASSERT_TRUE(client.read(result));
  EXPECT_EQ(result.sequence(), 0u);
  EXPECT_EQ(client.finish().error_code(), grpc::RESOURCE_EXHAUSTED);
}

TEST_P(StreamLimits, AFullMemoryBudgetHoldsTheClientBackUntilThereIsRoom) {
  // Each takes most of the budget; the second waits until the first has its result.
  const WireFrame large = natural(2500, 1800);
  StreamClient first(channel());
  ASSERT_TRUE(first.open("first"));
  ASSERT_TRUE(first.send_header(large, 0, 0));
  ASSERT_TRUE(first.send_rows(large, 0, 50));
  ASSERT_TRUE(wait_until_in_use(connection()));
  StreamClient second(channel());
  ASSERT_TRUE(second.open("second"));
  std::thread sender([&] {
    second.send(large, 0, 0);
    second.half_close();
  });
  absl::SleepFor(absl::Milliseconds(100));
  for (uint32_t y = 50; y < 1800; y += 50) ASSERT_TRUE(first.send_rows(large, y, 50));
  first.half_close();
  StreamResult result;
  EXPECT_TRUE(first.read(result));
  EXPECT_TRUE(first.finish().ok());
  EXPECT_TRUE(second.read(result));
  sender.join();
  EXPECT_TRUE(second.finish().ok());
}

TEST_P(StreamLimits, ASilentClientIsCutOffAndOneThatReadsNothingToo) {
  StreamClient silent(channel());
  ASSERT_TRUE(silent.open("silent"));
  EXPECT_REFUSED(silent.finish(), grpc::DEADLINE_EXCEEDED, "idle timeout");
  StreamClient halted(channel());
  ASSERT_TRUE(halted.open("halted"));
  halted.send_header(natural(64, 64), 0, 0);
  EXPECT_REFUSED(halted.finish(), grpc::DEADLINE_EXCEEDED, "idle timeout");
}

// A frame that is repeated is none of those that look-ahead waits for.
TEST_P(StreamLimits, ASessionFullOfFramesThatWaitForOthersIsCutOff) {
  StreamClient client(channel(), true, absl::Now() + absl::Seconds(20));
  v1::StreamOpen open = opening();
  open.set_lookahead(2);
  ASSERT_TRUE(client.open(open));
  for (int i = 0; i < 8; ++i) client.send(natural(16, 16), 0, 0);
  EXPECT_REFUSED(client.finish(), grpc::DEADLINE_EXCEEDED, "idle timeout");
}

TEST_P(StreamLimits, AFrameWhoseTimeIsUpIsDroppedAndTheSessionGoesOn) {
  const WireFrame large = natural(1600, 1000);
  StreamClient busy(channel());
  ASSERT_TRUE(busy.open("busy"));
  std::thread load([&] {
    busy.send(large, 0, 0);
    busy.half_close();
  });
  StreamClient client(channel());
  ASSERT_TRUE(client.open("late"));
  ASSERT_TRUE(client.send_header(large, 0, 0, false, /*timeout_ms=*/1));
  absl::SleepFor(absl::Milliseconds(20));
  for (uint32_t y = 0; y < 1000; y += 100) ASSERT_TRUE(client.send_rows(large, y, 100));
  ASSERT_TRUE(client.send(natural(16, 16), 1, 1));
  client.half_close();
  const std::vector<StreamResult> results = client.read_all();
  ASSERT_EQ(results.size(), 2u);
  EXPECT_TRUE(results[0].failed);
  EXPECT_EQ(results[0].failure.code(), static_cast<uint32_t>(grpc::DEADLINE_EXCEEDED));
  EXPECT_FALSE(results[1].failed);
  EXPECT_TRUE(client.finish().ok());
  load.join();
  EXPECT_TRUE(busy.finish().ok());
}

}  // namespace
}  // namespace candela::testing
