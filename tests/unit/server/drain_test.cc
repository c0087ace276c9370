#include <gtest/gtest.h>

#include <optional>

#include "server/session/sessions.h"

namespace candela {
namespace {

class CountingCall final : public SessionCall {
 public:
  void go_away() override { ++told; }
  void give_up() override {}
  int told = 0;
};

class DrainTest : public ::testing::Test {
 protected:
  std::shared_ptr<Drain> begin() {
    return Drain::begin(calls_, sessions_, table_, [this](bool drained) {
      EXPECT_EQ(ended_, std::nullopt) << "ended twice";
      ended_ = drained;
    });
  }
  void enter(CallGate& gate) { EXPECT_TRUE(gate.enter().ok()); }
  void leave(CallGate& gate) {
    gate.give_up_place();
    gate.leave();
  }

  CallGate calls_{"calls", 2};
  CallGate sessions_{"sessions", 2};
  SessionTable table_;
  std::optional<bool> ended_;
};

TEST_F(DrainTest, AnEmptyServerIsDrainedAtOnceAndTakesNobody) {
  begin();
  EXPECT_EQ(ended_, true);
  EXPECT_TRUE(absl::IsUnavailable(calls_.enter()));
  EXPECT_TRUE(absl::IsUnavailable(sessions_.enter()));
}

TEST_F(DrainTest, SessionsAreToldAndTheLastCallToLeaveEndsIt) {
  const auto session = std::make_shared<CountingCall>();
  ASSERT_TRUE(table_.enter("s", 0, /*resumed=*/false, session).ok());
  enter(calls_);
  enter(calls_);
  enter(sessions_);
  const auto drain = begin();
  EXPECT_EQ(session->told, 1);
  leave(sessions_);
  leave(calls_);
  calls_.give_up_place();
  EXPECT_EQ(ended_, std::nullopt) << "a client was not told yet";
  calls_.leave();
  EXPECT_EQ(ended_, true);
  drain->on_time();
}

TEST_F(DrainTest, ItsTimeEndsItAndWhoLeavesLaterDoesNot) {
  enter(calls_);
  begin()->on_time();
  EXPECT_EQ(ended_, false);
  leave(calls_);
}

}  // namespace
}  // namespace candela
