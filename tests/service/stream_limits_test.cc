// Limits of a session: a client that exceeds one is refused by name, and the server keeps nothing of it.
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "client/call/retry_schedule.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

using absl::StatusCode;

using StreamLimits = ServiceTest;
INSTANTIATE_TEST_SUITE_P(Transport, StreamLimits, ::testing::Bool(), transport_name);

v1::StreamOpen opening() { return open_of("limits"); }

// A frame of that size, of which only the header is meant to be sent.
WireFrame declared(uint32_t width, uint32_t height) {
  WireFrame frame = natural(1, 1);
  frame.desc.width = width;
  frame.desc.height = height;
  return frame;
}

// A message of a client. Frames have 16x16 pixels.
using Say = std::function<void(StreamClient&)>;

const WireFrame& small() {
  static const WireFrame frame = natural(16, 16);
  return frame;
}
Say open_as(const std::string& session) {
  return [=](StreamClient& c) { c.open(session); };
}
Say open(void (*set)(v1::StreamOpen&) = [](v1::StreamOpen&) {}) {
  return [=](StreamClient& c) {
    v1::StreamOpen open = opening();
    set(open);
    c.open(open);
  };
}
Say header(uint64_t sequence) {
  return [=](StreamClient& c) { c.send_header(small(), sequence, 0); };
}
Say header_of(uint32_t width, uint32_t height) {
  return [=](StreamClient& c) { c.send_header(declared(width, height), 0, 0); };
}
Say rows(uint32_t first, uint32_t count) {
  return [=](StreamClient& c) { c.send_rows(small(), first, count); };
}
Say frame(uint64_t sequence, int64_t time) {
  return [=](StreamClient& c) { c.send(small(), sequence, time); };
}
Say changes(uint64_t first, uint64_t last) {
  return [=](StreamClient& c) {
    for (uint64_t i = first; i <= last; ++i) c.change(i, {});
  };
}

struct Refused {
  const char* name;
  std::vector<Say> messages;
  const char* words;
  StatusCode code = StatusCode::kInvalidArgument;
};

TEST_P(StreamLimits, WhatASessionMayNotSayIsRefusedByName) {
  const Refused table[] = {
      {"nothing", {}, "half-closed before its open"},
      {"a frame before the open", {header(0)}, "`open`"},
      {"a name with a space", {open_as("sp ace")}, "open.session"},
      {"no name", {open_as("")}, "open.session"},
      {"a long name", {open_as(std::string(65, 'a'))}, "65 bytes"},
      {"look-ahead", {open([](auto& o) { o.set_lookahead(17); })}, "open.lookahead is 17"},
      {"cut threshold", {open([](auto& o) { o.set_cut_threshold_ev(NAN); })}, "cut_threshold_ev"},
      {"quality", {open([](auto& o) { o.set_jpeg_quality(101); })}, "jpeg_quality is 101"},
      {"encoding", {open([](auto& o) { o.set_encoding(static_cast<v1::Encoding>(9)); })}, "encoding is 9"},
      {"a JPEG of 16 bits",
       {open([](auto& o) {
         o.set_encoding(v1::ENCODING_JPEG);
         o.mutable_settings()->set_output_format(v1::OUTPUT_FORMAT_RGBA16);
       })},
       "JPEG"},
      // Bands that do not tile their frame.
      {"a band before its frame", {open(), rows(0, 4)}, "send `frame`"},
      {"too few rows", {open(), header(0), rows(0, 15)}, "15 of 16 rows"},
      {"too many rows", {open(), frame(0, 0), rows(0, 1)}, "every row"},
      {"a row twice", {open(), header(0), rows(0, 8), rows(7, 8)}, "begins at row 7 and row 8 is next"},
      {"a frame in a frame", {open(), header(0), header(1)}, "no band, but a band is due"},
      // Sizes, before any pixel.
      {"the largest size", {open(), header_of(~0u, ~0u)}, "4294967295", StatusCode::kResourceExhausted},
      {"a large size", {open(), header_of(16384, 16384)}, "2147483648 bytes", StatusCode::kResourceExhausted},
      {"no size", {open(), header_of(0, 5)}, "0x5"},
      {"look-ahead that can never fit",
       {open([](auto& o) { o.set_lookahead(16); }), header_of(1920, 1080)},
       "look-ahead of 16 frames of 1920x1080",
       StatusCode::kResourceExhausted},
      // Numbers and times that run backwards.
      {"sequence", {open(), frame(5, 1000), frame(4, 1000)}, "frame.sequence is 4 after 5"},
      {"time", {open(), frame(5, 1000), frame(6, 999)}, "frame.media_time_ns is 999 after 1000"},
      {"change", {open(), frame(5, 1000), changes(5, 5)}, "change.from_sequence is 5"},
      {"many changes", {open(), changes(1, v1::kMaxPendingChanges + 1)}, "16 changes"},
  };
  for (const auto& [name, messages, words, code] : table) {
    StreamClient client(channel());
    for (const Say& say : messages) say(client);
    client.half_close();
    EXPECT_TRUE(is_refused(code, words, status_of(client.finish()))) << name;
    EXPECT_TRUE(wait_until_idle(connection())) << name;
  }
}

TEST_P(StreamLimits, ASessionPastTheCapIsToldToComeBack) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(1);  // the sessions stay open, even on a machine that stands still
  const std::unique_ptr<Server> server = start_server(config);
  const auto channel = [&] {
    return GetParam() ? server->in_process_channel() : own_channel(server->addresses().at(0));
  };
  std::vector<std::unique_ptr<StreamClient>> clients;
  for (uint32_t i = 0; i < config.max_sessions; ++i) {
    clients.push_back(std::make_unique<StreamClient>(channel()));
    ASSERT_TRUE(clients.back()->open("s" + std::to_string(i)));
    StreamResult result;
    clients.back()->send(natural(4, 4), 0, 0);
    ASSERT_TRUE(clients.back()->read(result));
  }
  StreamClient late(channel());
  late.open("late");
  const grpc::Status refusal = late.finish();
  EXPECT_REFUSED(kUnavailable, "sessions, which is its limit", refusal);
  EXPECT_GT(retry_delay(refusal), absl::ZeroDuration());
  clients.pop_back();
  const absl::Time limit = absl::Now() + absl::Minutes(1);
  grpc::Status status;
  do {
    StreamClient again(channel());
    again.open("again");
    again.half_close();
    status = again.finish();
  } while (!status.ok() && absl::Now() < limit);
  EXPECT_OK(status);
}

// Frames that arrived whole are answered before the server refuses the next one.
TEST_P(StreamLimits, ARefusalComesAfterTheResultsOfWhatCameBefore) {
  StreamClient client(channel());
  ASSERT_TRUE(client.open(opening()));
  ASSERT_TRUE(client.send(natural(1200, 800), 0, 0));
  client.send_header(declared(1u << 20, 1), 1, 1);
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
  EXPECT_OK(first.finish());
  EXPECT_TRUE(second.read(result));
  sender.join();
  EXPECT_OK(second.finish());
}

TEST_P(StreamLimits, ASilentClientIsCutOffAndOneThatReadsNothingToo) {
  StreamClient silent(channel());
  ASSERT_TRUE(silent.open("silent"));
  EXPECT_REFUSED(kUnavailable, "idle timeout", silent.finish());
  StreamClient halted(channel());
  ASSERT_TRUE(halted.open("halted"));
  halted.send_header(natural(64, 64), 0, 0);
  EXPECT_REFUSED(kUnavailable, "idle timeout", halted.finish());
}

// Repeated frames do not count as the later frames that look-ahead waits for.
TEST_P(StreamLimits, ASessionFullOfFramesThatWaitForOthersIsCutOff) {
  StreamClient client(channel(), true, absl::Now() + absl::Seconds(20));
  v1::StreamOpen open = opening();
  open.set_lookahead(2);
  ASSERT_TRUE(client.open(open));
  for (int i = 0; i < 8; ++i) client.send(natural(16, 16), 0, 0);
  EXPECT_REFUSED(kUnavailable, "idle timeout", client.finish());
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
  EXPECT_OK(client.finish());
  load.join();
  EXPECT_OK(busy.finish());
}

}  // namespace
}  // namespace candela::testing
