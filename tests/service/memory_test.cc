// A client that takes memory and does not use it. Others still get theirs, and within seconds.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/call/retry_schedule.h"
#include "server/access/client_identity.h"
#include "server/session/client_memory.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/daemon.h"
#include "tests/support/figures.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr uint64_t kBudget = uint64_t{256} << 20;
// Far longer than an upload may stall while others wait, and far longer than any test waits.
constexpr char kLongIdleTimeout[] = "10m";
constexpr absl::Duration kSoon = absl::Minutes(1);

// Another build of candelad, to see these tests fail on it.
const char* candelad_under_test() {
  const char* other = std::getenv("CANDELA_TEST_CANDELAD");
  return other == nullptr ? CANDELAD : other;
}

std::string first_word(const std::string& words) { return words.substr(0, words.find(' ')); }

class Memory : public ::testing::Test {
 protected:
  Memory()
      : daemon_({"--listen", absl::StrCat("127.0.0.1:0,unix:", folder_.path("door")), "--memory-budget",
                 "256MiB", "--idle-timeout", kLongIdleTimeout, "--log-level", "info"},
                candelad_under_test()),
        address_(first_word(daemon_.wait_until_listening())),
        connection_(own_channel(address_)) {
    EXPECT_NE(address_, "") << daemon_.errors();
  }

  // Another client than those on address_: the local processes that may open this socket.
  std::string other_address() const { return absl::StrCat("unix:", folder_.path("door")); }
  uint64_t in_use() const {
    const absl::StatusOr<v1::GetServerInfoResponse> info = connection_.server_info();
    return info.ok() ? info->pool().bytes_in_use() : 0;
  }
  // Repeats a Render until it is taken; false if it is not within `limit`.
  static bool renders_within(const std::string& address, absl::Duration limit) {
    const Connection connection(own_channel(address));
    const WireFrame frame = natural(640, 360);
    const absl::Time until = absl::Now() + limit;
    while (absl::Now() < until) {
      if (connection.render({}, view(frame), until).ok()) return true;
      absl::SleepFor(absl::Milliseconds(200));
    }
    return false;
  }
  // Opens a session and sends a header, and `rows` rows after it.
  std::unique_ptr<StreamClient> begin_upload(const std::string& address, const std::string& session,
                                             const WireFrame& frame, uint32_t rows) const {
    auto client = std::make_unique<StreamClient>(own_channel(address));
    EXPECT_TRUE(client->open(session) && client->send_header(frame, 0, 0));
    EXPECT_TRUE(rows == 0 || client->send_rows(frame, 0, rows));
    return client;
  }
  bool wait_until_in_use_is(uint64_t least) const {
    return wait_until(connection_, [least](const auto& info) { return info.pool().bytes_in_use() >= least; });
  }

  const TemporaryFolder folder_;
  Daemon daemon_;
  const std::string address_;
  const Connection connection_;
};

// The frame alone has most of the budget, with staging copies as without.
WireFrame large_frame() { return natural(2900, 2900); }

// Sessions that sent a header without a pixel.
std::vector<std::unique_ptr<StreamClient>> hogs_at(const std::string& address) {
  std::vector<std::unique_ptr<StreamClient>> hogs;
  for (const uint32_t side : {2900u, 2048u, 1024u, 512u, 256u, 128u, 64u, 32u}) {
    WireFrame frame = natural(1, 1);
    frame.desc.width = frame.desc.height = side;
    for (int i = 0; i < 4; ++i) {
      hogs.push_back(std::make_unique<StreamClient>(own_channel(address)));
      EXPECT_TRUE(hogs.back()->open(absl::StrCat("hog-", side, "-", i)) &&
                  hogs.back()->send_header(frame, 0, 0));
    }
  }
  return hogs;
}

TEST_F(Memory, HeadersWithoutAPixelHoldNothing) {
  const auto hogs = hogs_at(address_);
  ASSERT_TRUE(wait_until(connection_, [&](const auto& info) { return info.sessions() == hogs.size(); }));
  // At most the heartbeat's, once the tiers are measured.
  EXPECT_TRUE(wait_until(connection_, [](const auto& info) { return info.pool().bytes_in_use() < 1 << 20; }));
  EXPECT_OK(connection_.render({}, view(large_frame())));
}

TEST_F(Memory, HeadersWithoutAPixelDelayNobody) {
  Bystander bystander(address_, natural(160, 90), absl::Now() + absl::Minutes(2));
  constexpr absl::Duration kPause = absl::Milliseconds(10);
  bystander.latencies_ms(20, kPause);
  double fair = 0;
  {
    const Load neighbour(address_, "neighbour", natural(640, 360));
    bystander.latencies_ms(20, kPause);
    fair = quantile(bystander.latencies_ms(150, kPause), 0.99);
  }
  const auto hogs = hogs_at(address_);
  std::vector<double> latencies;
  for (int i = 0; i < 15; ++i) {
    const std::vector<double> some = bystander.latencies_ms(10, kPause);
    latencies.insert(latencies.end(), some.begin(), some.end());
    EXPECT_OK(connection_.health());
  }
  const double attacked = quantile(latencies, 0.99);
  std::cout << "p99 of the bystander: " << fair << " ms beside a fair neighbour, " << attacked
            << " ms beside " << hogs.size() << " headers without a pixel\n";
  EXPECT_LE(attacked, 2 * fair + 20);
  record_figure("headers_without_a_pixel", attacked, "ms", fair);
}

TEST_F(Memory, AnUploadThatStallsLosesItsMemoryToAFrameThatWaits) {
  const WireFrame large = large_frame();
  const auto stalled = begin_upload(address_, "stalled", large, 1);
  ASSERT_TRUE(wait_until_in_use_is(kBudget / 2));
  const absl::Time begin = absl::Now();
  StreamClient client(own_channel(address_), true, begin + absl::Minutes(2));
  ASSERT_TRUE(client.open("waits") && client.send(large, 0, 0));
  StreamResult result;
  ASSERT_TRUE(client.read(result));
  EXPECT_FALSE(result.failed);
  EXPECT_LT(absl::Now() - begin, ClientMemory::kStalled + kSoon);
  const grpc::Status status = stalled->finish();
  EXPECT_REFUSED(kUnavailable, "brought no pixels", status);
  EXPECT_GT(retry_delay(status), absl::ZeroDuration());
  // It may come back and gets the same image.
  const std::vector<StreamResult> again = stream_all(own_channel(address_), open_of("stalled"), {large});
  ASSERT_EQ(again.size(), 1u);
  EXPECT_TRUE(again[0].pixels == result.pixels);
}

// A refused Render waits too, outside.
TEST_F(Memory, AnUploadThatStallsLosesItsMemoryToARenderThatWasRefused) {
  const WireFrame large = large_frame();
  std::vector<std::unique_ptr<StreamClient>> stalled;
  stalled.push_back(begin_upload(address_, "stalled", large, 1));
  ASSERT_TRUE(wait_until_in_use_is(kBudget / 2));
  const Connection connection(own_channel(address_));
  const absl::Time until = absl::Now() + kSoon;
  absl::Status status = connection.render({}, view(large), until).status();
  EXPECT_REFUSED(kUnavailable, "", status);
  while (!status.ok() && absl::Now() < until) {
    absl::SleepFor(absl::Seconds(1));
    status = connection.render({}, view(large), until).status();
  }
  EXPECT_OK(status);
}

// The control: the same pause, and nobody waits.
TEST_F(Memory, AnUploadThatNobodyWaitsForMayPause) {
  const WireFrame large = large_frame();
  const auto client = begin_upload(address_, "pauses", large, 1);
  ASSERT_TRUE(wait_until_in_use_is(kBudget / 2));
  EXPECT_TRUE(renders_within(address_, kSoon));
  absl::SleepFor(absl::Seconds(4));
  for (uint32_t y = 1; y < large.desc.height; y += 50) {
    ASSERT_TRUE(client->send_rows(large, y, std::min(50u, large.desc.height - y)));
  }
  StreamResult result;
  EXPECT_TRUE(client->read(result));
}

// It brings a few rows a second, and stalled uploads and frames that wait come and go beside it.
TEST_F(Memory, AHonestSlowUploadIsNotStarvedByFramesThatWait) {
  const WireFrame small = natural(64, 24);
  const auto slow = begin_upload(address_, "slow", small, 1);
  ASSERT_TRUE(wait_until(connection_, [](const auto& info) { return info.pool().bytes_in_use() > 0; }));
  const WireFrame large = large_frame();
  std::atomic<bool> stop = false;
  std::thread others([&] {
    for (int i = 0; !stop; ++i) {
      const auto stalled = begin_upload(address_, absl::StrCat("stalled", i), large, 1);
      absl::SleepFor(absl::Milliseconds(300));
      const auto waits = begin_upload(address_, absl::StrCat("waits", i), large, 1);
      absl::SleepFor(absl::Milliseconds(2500));
    }
  });
  for (uint32_t y = 1; y < small.desc.height; ++y) {
    absl::SleepFor(absl::Milliseconds(400));
    if (!slow->send_rows(small, y, 1)) break;
  }
  StreamResult result;
  const bool answered = slow->read(result);
  stop = true;
  others.join();
  EXPECT_TRUE(answered) << slow->finish().error_message();
}

// Its uploads go on all the time, so none of them ever stalls.
TEST_F(Memory, AClientTakesNoMoreThanItsShareBesideAnother) {
  const WireFrame frame = natural(1200, 1200);  // about 25 MB of the budget
  Bystander other(other_address());
  other.latency_ms();
  std::vector<std::unique_ptr<StreamClient>> hogs;
  for (int i = 0; i < 12; ++i) hogs.push_back(begin_upload(address_, absl::StrCat("hog", i), frame, 1));
  EXPECT_TRUE(wait_until_in_use_is(kBudget / 4));
  // When the uploads have their share, the hog's own next frame is told why; the other client's is taken at
  // once.
  absl::Status own;
  for (const absl::Time until = absl::Now() + kSoon; own.ok() && absl::Now() < until;) {
    own = connection_.render({}, view(frame), until).status();
  }
  EXPECT_REFUSED(kUnavailable, "its share of", own);
  EXPECT_LE(in_use(), kBudget / 2);
  const Connection by_other(own_channel(other_address()));
  EXPECT_OK(by_other.render({}, view(frame), absl::Now() + kSoon));
}

TEST_F(Memory, AClientThatIsAloneMayUseAllOfIt) {
  const WireFrame frame = natural(1200, 1200);
  std::vector<std::unique_ptr<StreamClient>> uploads;
  for (int i = 0; i < 8; ++i) uploads.push_back(begin_upload(address_, absl::StrCat("u", i), frame, 1));
  EXPECT_TRUE(wait_until_in_use_is(kBudget / 2 + kBudget / 8)) << in_use();
}

// On a unix: socket the proxy says who calls.
TEST_F(Memory, BehindAProxyClientsAreToldApartByTheAddressThatItAdds) {
  const WireFrame frame = natural(1200, 1200);
  const auto channel = own_channel(other_address());
  std::vector<std::unique_ptr<OpenCall>> calls;
  const auto upload = [&](const std::string& forwarded) {
    calls.push_back(std::make_unique<OpenCall>(channel, [&](grpc::ClientContext& context) {
      context.AddMetadata("x-forwarded-for", forwarded);
      context.set_deadline(absl::ToChronoTime(absl::Now() + kSoon));
    }));
    calls.back()->write(start_of(frame));
    calls.back()->write(band_of(frame, 0, 1));
  };
  upload("192.0.2.1");
  // What a client claims itself stands before what the proxy adds.
  for (int i = 0; i < 12; ++i) upload(absl::StrCat("198.51.100.", i, ", 192.0.2.2"));
  EXPECT_TRUE(wait_until_in_use_is(kBudget / 4));
  absl::SleepFor(absl::Milliseconds(500));         // what they get beyond their share
  EXPECT_LE(in_use(), kBudget / 2 + kBudget / 8);  // half of what the first leaves, and what the first has
}

v1::Settings with_table(uint32_t size, char fill) {
  v1::Settings settings;
  settings.set_curve(v1::TONE_CURVE_TABLE);
  settings.mutable_table()->set_size(size);
  settings.mutable_table()->set_values(std::string(size_t{size} * size * size * 6, fill));
  return settings;
}

// A table of 65^3 points has 1.65 MB, and 32 MiB are for tables.
TEST_F(Memory, TablesOfChangesThatWaitAreCounted) {
  const auto announce = [](StreamClient& client, int changes) {
    for (int i = 1; i <= changes; ++i) {
      if (!client.change(static_cast<uint64_t>(i), with_table(65, static_cast<char>(i)))) return;
    }
  };
  StreamClient first(own_channel(address_));
  StreamResult result;
  ASSERT_TRUE(first.open("first"));
  announce(first, 16);
  ASSERT_TRUE(first.send(natural(8, 8), 0, 0) && first.read(result));  // all changes are read by now
  StreamClient second(own_channel(address_), true, absl::Now() + absl::Minutes(1));
  ASSERT_TRUE(second.open("second"));
  announce(second, 16);
  EXPECT_REFUSED(kUnavailable, "colour table", second.finish());
  // With the first session its tables go.
  first.half_close();
  EXPECT_OK(first.finish());
  StreamClient third(own_channel(address_), true, absl::Now() + absl::Minutes(1));
  ASSERT_TRUE(third.open("third"));
  announce(third, 12);
  EXPECT_TRUE(third.send(natural(8, 8), 0, 0) && third.read(result));
}

// Each has filled its window of HTTP/2 and waits for memory. gRPC's quota must not end them.
TEST_F(Memory, SixtyFourSessionsThatWaitAreAllAnswered) {
  const WireFrame frame = natural(1600, 1000);  // 12.8 MB, three times what gRPC accepts ahead
  const absl::Time until = absl::Now() + absl::Minutes(8);
  std::vector<std::thread> clients;
  std::atomic<int> answered = 0;
  for (int i = 0; i < 64; ++i) {
    clients.emplace_back([&, i] {
      for (;;) {
        StreamClient client(own_channel(address_), true, until);
        StreamResult result;
        client.open(absl::StrCat("waits", i));
        if (client.send(frame, 0, 0) && client.read(result) && !result.failed) {
          ++answered;
          return;
        }
        // On a busy machine an upload may stall or wait too long. Then the server, and not gRPC, says when to
        // come back.
        const grpc::Status status = client.finish();
        if (retry_delay(status) == absl::ZeroDuration()) {
          ADD_FAILURE() << "session " << i << ": " << status.error_code() << " " << status.error_message();
          return;
        }
        absl::SleepFor(retry_delay(status));
      }
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(answered, 64);
}

// Renders frames with `calls` at a time, each over a connection of its own, while it exists.
class Renders {
 public:
  Renders(const std::string& address, int calls) {
    for (int i = 0; i < calls; ++i) {
      threads_.emplace_back([this, address] {
        const Connection connection(own_channel(address));
        // Frames that take the render thread far longer than their pixels take the connection.
        const WireFrame frame = natural(320 / kSlower, 180 / kSlower);
        v1::Settings settings;
        settings.set_tier("reference");
        while (!stop_) {
          if (connection.render(settings, view(frame)).ok()) ++done_;
        }
      });
    }
  }
  ~Renders() {
    stop_ = true;
    for (std::thread& thread : threads_) thread.join();
  }
  double done() const { return static_cast<double>(done_); }

 private:
  std::atomic<bool> stop_ = false;
  std::atomic<uint64_t> done_ = 0;
  std::vector<std::thread> threads_;
};

TEST_F(Memory, ManyConnectionsOfAClientHaveOneShareOfTheDevice) {
  const Renders crowd(address_, 12);
  const Renders other(other_address(), 3);
  absl::SleepFor(absl::Seconds(1));
  const double crowd_before = crowd.done(), other_before = other.done();
  absl::SleepFor(absl::Seconds(5));
  const double by_crowd = crowd.done() - crowd_before, by_other = other.done() - other_before;
  const double share = by_other / (by_crowd + by_other);
  std::cout << "three calls beside twelve got " << share << " of the frames\n";
  EXPECT_GE(share, 0.33);
}

// Who a client is, and how much of a budget it may hold.

using Answer = ClientBudget::Answer;

TEST(ClientAddress, IsTheSameForEveryPortOfAHost) {
  EXPECT_EQ(client_address("ipv4:192.0.2.1:1", ""), client_address("ipv4:192.0.2.1:65535", ""));
  EXPECT_NE(client_address("ipv4:192.0.2.1:1", ""), client_address("ipv4:192.0.2.2:1", ""));
}

TEST(ClientAddress, IsTheNetworkOfAnIpv6Host) {
  const std::string one = client_address("ipv6:%5B2001:db8:1:2::1%5D:5", "");
  EXPECT_EQ(one, client_address("ipv6:[2001:db8:1:2:ffff::9]:6", ""));
  EXPECT_NE(one, client_address("ipv6:%5B2001:db8:1:3::1%5D:5", ""));
  EXPECT_EQ(one, "2001:db8:1:2::/64");
  EXPECT_EQ(client_address("ipv6:%5B::ffff:192.0.2.1%5D:5", ""), client_address("ipv4:192.0.2.1:7", ""));
}

TEST(ClientAddress, IsBelievedOnlyFromAProxyOnAUnixSocket) {
  EXPECT_EQ(client_address("unix:", "192.0.2.1"), client_address("ipv4:192.0.2.1:7", ""));
  EXPECT_EQ(client_address("unix:/run/door", "198.51.100.9, 192.0.2.1"), "192.0.2.1");
  EXPECT_EQ(client_address("ipv4:192.0.2.1:7", "198.51.100.9"), "192.0.2.1");
  const std::string local = client_address("unix:", "");
  EXPECT_EQ(client_address("unix:", "no address"), local);
  EXPECT_EQ(client_address("unix:", "192.0.2.1, "), local);
  EXPECT_EQ(client_address("unix:", std::string(100'000, '1')), local);
  EXPECT_EQ(client_address("unix:", std::string(100'000, ',') + "192.0.2.1"), "192.0.2.1");
}

TEST(ClientAddress, IsTheSameForAConnectionAndItsCalls) {
  sockaddr_storage peer{};
  auto& four = reinterpret_cast<sockaddr_in&>(peer);
  four.sin_family = AF_INET;
  inet_pton(AF_INET, "192.0.2.1", &four.sin_addr);
  EXPECT_EQ(client_address(peer), "192.0.2.1");
  peer = {};
  auto& six = reinterpret_cast<sockaddr_in6&>(peer);
  six.sin6_family = AF_INET6;
  for (const char* host : {"2001:db8:1:2::1", "::ffff:192.0.2.1"}) {
    inet_pton(AF_INET6, host, &six.sin6_addr);
    EXPECT_EQ(client_address(peer), client_address(std::string("ipv6:[") + host + "]:5", ""));
  }
  peer = {};
  peer.ss_family = AF_UNIX;
  EXPECT_EQ(client_address(peer), client_address("unix:", ""));
}

class Budget : public ::testing::Test {
 protected:
  void visit(ClientId client) {
    visits_.push_back(std::make_unique<ClientPresence::Visit>(presence_, client));
  }

  ClientPresence presence_;
  ClientBudget budget_{1000, 50, presence_};
  std::vector<std::unique_ptr<ClientPresence::Visit>> visits_;
};

TEST_F(Budget, IsAllForAClientThatIsAlone) {
  visit(1);
  visit(1);
  EXPECT_EQ(budget_.change(1, 0, 600), Answer::kGranted);
  EXPECT_EQ(budget_.change(1, 0, 400), Answer::kGranted);
  EXPECT_EQ(budget_.change(1, 0, 1), Answer::kNoRoom);
  EXPECT_EQ(budget_.change(1, 600, 0), Answer::kGranted);
  EXPECT_EQ(budget_.held(), 400u);
}

TEST_F(Budget, LeavesHalfForTheNextClientHoweverManyThereAre) {
  for (ClientId client = 1; client <= 3; ++client) visit(client);
  const uint64_t left[] = {500, 250, 130};
  for (ClientId client = 1; client <= 3; ++client) {
    while (budget_.change(client, 0, 10) == Answer::kGranted) {
    }
    EXPECT_EQ(1000 - budget_.held(), left[client - 1]);
    EXPECT_EQ(budget_.change(client, 0, 10), Answer::kOverShare);
  }
}

TEST_F(Budget, GivesAClientThatHoldsNothingWhateverFits) {
  visit(1);
  visit(2);
  EXPECT_EQ(budget_.change(1, 0, 900), Answer::kGranted);
  EXPECT_EQ(budget_.change(2, 0, 100), Answer::kGranted);
  EXPECT_EQ(budget_.change(1, 900, 1000), Answer::kNoRoom);
  EXPECT_EQ(budget_.change(1, 900, 200), Answer::kGranted);
  EXPECT_EQ(budget_.change(1, 0, 400), Answer::kOverShare);
  EXPECT_EQ(budget_.change(1, 0, 400, /*least_share=*/600), Answer::kGranted);
}

TEST_F(Budget, IsTheClientsAloneAgainWhenTheOthersHaveGone) {
  visit(1);
  visit(2);
  EXPECT_EQ(budget_.change(1, 0, 400), Answer::kGranted);
  EXPECT_EQ(budget_.change(1, 0, 400), Answer::kOverShare);
  visits_.pop_back();
  EXPECT_EQ(budget_.change(1, 0, 400), Answer::kGranted);
}

class Shared : public ::testing::Test {
 protected:
  const std::shared_ptr<ClientMemory> memory_ = std::make_shared<ClientMemory>(1000, 50, absl::Seconds(30));
  const absl::Time now_ = absl::FromUnixSeconds(1'000'000);

  bool yields(uint64_t bytes, absl::Duration taken, absl::Duration silent, absl::Duration later) const {
    return !memory_->check_upload(1, bytes, taken, silent, now_ + later).ok();
  }
};

TEST_F(Shared, AnUploadYieldsOnlyToASmallerFrameThatWaitsAndOnlyIfItStallsOrTakesLong) {
  ASSERT_OK_AND_ASSIGN(const auto whole, memory_->claim_frame(1, 1000, now_));
  EXPECT_FALSE(yields(1000, absl::Hours(1), absl::Hours(1), absl::ZeroDuration())) << "nobody waits";
  EXPECT_TRUE(absl::IsUnavailable(memory_->claim_frame(2, 300, now_).status()));
  EXPECT_TRUE(yields(1000, absl::Seconds(3), absl::Seconds(3), absl::Seconds(1)));
  EXPECT_TRUE(yields(1000, absl::Seconds(31), absl::ZeroDuration(), absl::Seconds(1)));
  EXPECT_FALSE(yields(1000, absl::Seconds(29), absl::Seconds(1), absl::Seconds(1)));
  EXPECT_FALSE(yields(299, absl::Hours(1), absl::Hours(1), absl::Seconds(1))) << "it would not help";
  EXPECT_FALSE(yields(1000, absl::Hours(1), absl::Hours(1), absl::Seconds(3))) << "who waited has gone";
}

TEST_F(Shared, ALargeFrameLeavesRoomForASmallerOneThatWaits) {
  ASSERT_OK_AND_ASSIGN(auto whole, memory_->claim_frame(1, 1000, now_));
  EXPECT_FALSE(memory_->claim_frame(2, 300, now_).ok());
  whole.reset();
  EXPECT_FALSE(memory_->claim_frame(3, 800, now_).ok());
  const auto small = memory_->claim_frame(2, 300, now_);
  EXPECT_OK(small);
  EXPECT_OK(memory_->claim_frame(3, 700, now_));
}

TEST_F(Shared, WhatAFrameGivesBackEarlyIsFree) {
  ASSERT_OK_AND_ASSIGN(auto frame, memory_->claim_frame(1, 1000, now_));
  frame->shrink(400);
  EXPECT_OK(memory_->claim_frame(2, 600, now_));
  frame.reset();
  EXPECT_OK(memory_->claim_frame(2, 1000, now_));
}

}  // namespace
}  // namespace candela::testing
