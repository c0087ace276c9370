// Limits of a session: a client that exceeds one is refused by name, and the server keeps nothing of it.
#include <cmath>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "client/call/retry/retry_info.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/stream_client.h"

namespace candela::testing {
namespace {

class StreamLimits : public ServiceTest {
 protected:
  // The status of a call with these messages, once its session slot is released.
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
                 grpc::INVALID_ARGUMENT, "no band, but a band is due");
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
  const grpc::Status refusal = late.finish();
  EXPECT_REFUSED(refusal, grpc::UNAVAILABLE, "sessions, which is its limit");
  EXPECT_GT(retry_delay(refusal), absl::ZeroDuration());
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

// Frames that arrived whole are answered before the server refuses the next one.
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
  // Each frame takes most of the budget, so the second waits until the first has its result.
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
  EXPECT_REFUSED(silent.finish(), grpc::UNAVAILABLE, "idle timeout");
  StreamClient halted(channel());
  ASSERT_TRUE(halted.open("halted"));
  halted.send_header(natural(64, 64), 0, 0);
  EXPECT_REFUSED(halted.finish(), grpc::UNAVAILABLE, "idle timeout");
}

// Repeated frames do not count as the later frames that look-ahead waits for.
TEST_P(StreamLimits, ASessionFullOfFramesThatWaitForOthersIsCutOff) {
  StreamClient client(channel(), true, absl::Now() + absl::Seconds(20));
  v1::StreamOpen open = opening();
  open.set_lookahead(2);
  ASSERT_TRUE(client.open(open));
  for (int i = 0; i < 8; ++i) client.send(natural(16, 16), 0, 0);
  EXPECT_REFUSED(client.finish(), grpc::UNAVAILABLE, "idle timeout");
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
