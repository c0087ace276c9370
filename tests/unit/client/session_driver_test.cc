// A session's driver in virtual time and in one thread: faults at every event that a film has, and what it
// waits for. Nothing here waits in real time.
#include "client/session_driver.h"

#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "tests/support/status.h"
#include "tests/unit/client/session_film.h"

namespace candela {
namespace {

using testing::VirtualClock;

TEST(SessionDriver, ResultsComeOnceAndInOrder) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  const absl::Time begin = clock.now();
  const Outcome got = run(session, 12, 7);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(12, 7));
  EXPECT_EQ(got.stats.resumes, 0u);
  EXPECT_EQ(got.stats.window, 2u);
  EXPECT_EQ(clock.now(), begin);
}

// A call is lost before each event that a film has, then both that call and the one after it.
TEST(SessionDriver, ALossAtAnyEventCostsAndDoublesNoResult) {
  for (const uint32_t lookahead : {0u, 2u}) {
    for (const int again : {0, 5}) {
      bool lost = true;
      for (int cut = 0; lost; ++cut) {
        SCOPED_TRACE(cut);
        VirtualClock clock;
        SessionOptions wanted = options();
        wanted.lookahead = lookahead;
        FakeSession session(2, wanted, clock);
        lost = false;
        const Outcome got = run(session, 9, 4, [&](int event) {
          if ((event != cut && (again == 0 || event != cut + again)) || session.servers.call_now == nullptr)
            return;
          session.servers.call_now->lose(kLost);
          lost |= event == cut;
        });
        ASSERT_OK(got.status);
        ASSERT_EQ(got.values, expected(9, 4));
        ASSERT_EQ(got.stats.answered, 9u);
        const std::vector<FakeServers::Open>& opens = session.servers.opens;
        for (size_t i = 1; i < opens.size(); ++i) {
          EXPECT_NE(opens[i].server, opens[i - 1].server);
          const std::string& token = opens[i].message.resume_token();
          const bool changed = !token.empty() && std::stoi(token) >= 4;
          EXPECT_EQ(opens[i].message.settings().exposure().manual_ev(), changed ? 2 : 1);
        }
      }
    }
  }
}

TEST(SessionDriver, TheLastTokenResumesIt) {
  VirtualClock clock;
  FakeSession session(2, options(), clock);
  session.servers.on_frame = [](size_t server, uint64_t sequence) {
    return server == 0 && sequence == 6 ? kLost : grpc::Status::OK;
  };
  const Outcome got = run(session, 12);
  EXPECT_EQ(got.values, expected(12));
  EXPECT_EQ(got.stats.resumes, 1u);
  EXPECT_GE(got.stats.sent_again, 1u);
  EXPECT_EQ(got.stats.server, "one");
  EXPECT_EQ(got.stats.last_loss, absl::UnavailableError("lost"));
  ASSERT_EQ(session.servers.opens.size(), 2u);
  EXPECT_EQ(session.servers.opens[1].message.resume_token(), "5");
}

TEST(SessionDriver, WithoutATokenYetItOpensAnew) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  int losses = 0;
  session.servers.on_frame = [&](size_t, uint64_t) { return losses++ < 3 ? kLost : grpc::Status::OK; };
  const Outcome got = run(session, 5, 1);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(5, 1));
  EXPECT_EQ(got.stats.resumes, 3u);
  EXPECT_GT(got.stats.time_without_results, absl::ZeroDuration());
  for (const FakeServers::Open& open : session.servers.opens) EXPECT_EQ(open.message.resume_token(), "");
}

TEST(SessionDriver, ItGivesUpWhenItsLimitIsOver) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  const absl::Time begin = clock.now();
  session.servers.on_frame = [](size_t, uint64_t sequence) {
    return sequence == 2 ? kLost : grpc::Status::OK;
  };
  const Outcome got = run(session, 9);
  EXPECT_EQ(got.values, expected(2));
  EXPECT_EQ(got.status, absl::UnavailableError("no server has taken the session on for 5s: lost"));
  EXPECT_EQ(clock.now() - begin, absl::Seconds(5));
  EXPECT_EQ(got.stats.time_without_results, absl::Seconds(5));
  EXPECT_GT(session.servers.opens.size(), 4u);
}

TEST(SessionDriver, SilenceIsMeasuredFromTheLastProgress) {
  VirtualClock clock;
  FakeSession session(2, options(), clock);
  session.servers.on_frame = [](size_t server, uint64_t sequence) {
    return server == 0 && sequence == 4 ? FakeServers::kSilent : grpc::Status::OK;
  };
  const Outcome got = run(session, 9);
  EXPECT_EQ(got.values, expected(9));
  ASSERT_EQ(session.servers.opens.size(), 2u);
  EXPECT_EQ(session.servers.opens[1].when - session.servers.opens[0].when, absl::Minutes(1));
  EXPECT_EQ(session.servers.opens[1].message.resume_token(), "3");
  EXPECT_EQ(got.stats.last_loss, absl::UnavailableError("no answer from zero within 1m: it hangs"));
}

TEST(SessionDriver, AServerThatDoesNotOpenItIsLeftAfterTenSeconds) {
  VirtualClock clock;
  FakeSession session(2, options(), clock);
  session.servers.on_open = [](size_t server) {
    return server == 0 ? FakeServers::kSilent : grpc::Status::OK;
  };
  EXPECT_EQ(run(session, 3).values, expected(3));
  EXPECT_EQ(session.servers.opens.at(1).when - session.servers.opens.at(0).when, absl::Seconds(10));
}

TEST(SessionDriver, AServerThatOwesNothingMayBeSilent) {
  VirtualClock clock;
  SessionOptions wanted = options();
  wanted.lookahead = 1;
  FakeSession session(1, wanted, clock);
  session.driver.start();
  session.settle();
  EXPECT_EQ(session.driver.deadline(), absl::InfiniteFuture());
  clock.advance(absl::Hours(1));
  ASSERT_OK(session.state.submit(frame(0)));
  session.driver.on_event(CallEvent::kWoken);
  EXPECT_EQ(session.driver.deadline(), clock.now() + absl::Minutes(1)) << "it has data to read";
  session.settle();
  EXPECT_EQ(session.driver.deadline(), absl::InfiniteFuture()) << "look-ahead holds the frame back";
  session.servers.on_frame = [](size_t, uint64_t) { return FakeServers::kSilent; };
  ASSERT_OK(session.state.submit(frame(1)));
  session.settle();
  EXPECT_EQ(session.driver.deadline(), clock.now() + absl::Minutes(1));
}

// One that has nothing to send is not resumed, and the time does not count. It waits for nothing else.
TEST(SessionDriver, WithoutAFrameItNeedsNoServer) {
  for (const grpc::Status& loss : {kLost, full(60)}) {
    VirtualClock clock;
    FakeSession session(1, options(), clock);
    session.driver.start();
    session.settle();
    session.servers.call_now->lose(loss);
    while (session.step()) continue;
    ASSERT_FALSE(session.driver.ended());
    EXPECT_EQ(session.servers.opens.size(), 1u);
    clock.advance(absl::Hours(1));
    ASSERT_OK(session.state.submit(frame(0)));
    session.state.finish();
    while (session.step()) continue;
    ASSERT_OK_AND_ASSIGN(const std::optional<FrameResult> result, session.state.next_result());
    EXPECT_EQ(result->sequence, 0u);
    EXPECT_EQ(session.state.stats().resumes, 1u);
    EXPECT_EQ(session.state.stats().time_without_results, absl::ZeroDuration());
  }
}

constexpr absl::string_view kCancelled = "the session was cancelled";

TEST(SessionDriver, CancelAtAnyEventEndsIt) {
  bool cancelled = true;
  for (int at = 0; cancelled; ++at) {
    SCOPED_TRACE(at);
    VirtualClock clock;
    FakeSession session(2, options(), clock);
    const absl::Time begin = clock.now();
    session.servers.on_frame = [](size_t server, uint64_t sequence) {
      return server == 0 && sequence == 3 ? full(1) : grpc::Status::OK;
    };
    cancelled = false;
    const Outcome got = run(session, 9, 1000, [&](int event) {
      if (event != at || session.driver.ended()) return;
      cancelled = true;
      session.state.cancel();
    });
    EXPECT_EQ(got.status, cancelled ? absl::CancelledError(kCancelled) : absl::OkStatus());
    EXPECT_LE(got.events, at + 6) << "what was in progress";
    EXPECT_EQ(clock.now(), begin);
  }
}

TEST(SessionDriver, CancelEndsEveryWait) {
  const auto lost_at_once = [](FakeSession& session) {
    session.servers.on_open = [](size_t) { return full(3); };
  };
  const auto lost_later = [](FakeSession& session) {
    session.servers.on_frame = [](size_t, uint64_t) { return full(3); };
  };
  const auto hangs = [](FakeSession& session) {
    session.servers.on_frame = [](size_t, uint64_t) { return FakeServers::kSilent; };
  };
  const auto opens_never = [](FakeSession& session) {
    session.servers.on_open = [](size_t) { return FakeServers::kSilent; };
  };
  const std::vector<std::function<void(FakeSession&)>> cases{lost_at_once, lost_later, hangs, opens_never,
                                                             [](FakeSession&) {}};
  for (size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    VirtualClock clock;
    FakeSession session(1, options(), clock);
    cases[i](session);
    const bool idle = i + 1 == cases.size();
    session.driver.start();
    session.settle();
    if (idle) {
      session.servers.call_now->lose(full(3));
      while (session.step()) continue;
    } else if (session.state.was_open()) {
      ASSERT_OK(session.state.submit(frame(0)));
      session.settle();
    }
    ASSERT_FALSE(session.driver.ended());
    EXPECT_EQ(session.driver.deadline() == absl::InfiniteFuture(), idle);
    session.state.cancel();
    session.settle();
    EXPECT_TRUE(session.driver.ended());
    EXPECT_EQ(session.state.next_result().status(), absl::CancelledError(kCancelled));
  }
}

}  // namespace
}  // namespace candela
