// A client with a very slow connection. The server ends it in time and keeps nothing of it, and no other
// client notices.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <thread>

#include "absl/time/clock.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/neighbours.h"
#include "tests/service/sessions/stream_client.h"
#include "tests/service/sessions/wire_cutter.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

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

}  // namespace
}  // namespace candela::testing
