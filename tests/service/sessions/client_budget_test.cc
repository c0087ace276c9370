// Who a client is, and how much of a budget it may hold.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

#include <memory>
#include <string>
#include <vector>

#include "server/access/client_identity.h"
#include "server/session/client_memory.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

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
