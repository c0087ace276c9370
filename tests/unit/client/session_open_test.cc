// How long a session waits for servers that do not take it, in virtual time.
#include <gtest/gtest.h>

#include <vector>

#include "client/call/retry_schedule.h"
#include "tests/unit/client/session_film.h"

namespace candela {
namespace {

using testing::VirtualClock;

TEST(SessionOpen, AFullServerIsAskedWhenItSaysAndNotBefore) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  bool was_full = false;
  session.servers.on_frame = [&](size_t, uint64_t sequence) {
    return sequence == 2 && !std::exchange(was_full, true) ? full(3) : grpc::Status::OK;
  };
  const Outcome got = run(session, 5);
  EXPECT_EQ(got.values, expected(5));
  ASSERT_EQ(session.servers.opens.size(), 2u);
  const absl::Duration wait = session.servers.opens[1].when - session.servers.opens[0].when;
  EXPECT_GE(wait, absl::Seconds(3));
  EXPECT_LE(wait, absl::Seconds(4.5));
  EXPECT_EQ(got.stats.time_without_results, wait);
}

TEST(SessionOpen, AServerThatWantsToBeLeftAloneForTooLongIsNotAskedAgain) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  const absl::Time begin = clock.now();
  session.servers.on_frame = [](size_t, uint64_t) { return full(60); };
  EXPECT_REFUSED(kUnavailable, "for 5s: full", run(session, 5).status);
  EXPECT_EQ(session.servers.opens.size(), 1u);
  EXPECT_EQ(clock.now() - begin, absl::Seconds(5));
}

TEST(SessionOpen, AFullServerIsWaitedForBeforeTheFirstOpen) {
  VirtualClock clock;
  SessionOptions wanted = options();
  std::vector<std::string> waits;  // the servers that failed last
  wanted.on_open_wait = [&](const std::string& server, const absl::Status& why) {
    EXPECT_EQ(why.message(), "full");
    waits.push_back(server);
  };
  FakeSession session(2, wanted, clock);
  session.servers.on_open = [&](size_t) {
    return session.servers.opens.size() < 5 ? full(1) : grpc::Status::OK;
  };
  const Outcome got = run(session, 5);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.stats.resumes, 0u);
  EXPECT_EQ(waits, (std::vector<std::string>{"one", "zero", "one"}));
  const std::vector<FakeServers::Open>& opens = session.servers.opens;
  EXPECT_EQ(opens.at(1).when, opens.at(0).when) << "another server is asked at once";
  for (size_t i = 2; i < opens.size(); ++i) EXPECT_GE(opens[i].when - opens[i - 2].when, absl::Seconds(1));
}

TEST(SessionOpen, TheFirstOpenHasALimitAndZeroMeansOnce) {
  for (const absl::Duration limit : {absl::Seconds(2), absl::ZeroDuration()}) {
    VirtualClock clock;
    SessionOptions wanted = options();
    wanted.resume_limit = limit;
    FakeSession session(1, wanted, clock);
    const absl::Time begin = clock.now();
    session.servers.on_open = [](size_t) { return full(1); };
    const bool once = limit == absl::ZeroDuration();
    EXPECT_EQ(run(session, 1).status.message(),
              once ? "full" : "no server opens the session within 2s: full");
    EXPECT_EQ(session.servers.opens.size() == 1, once);
    EXPECT_LE(clock.now() - begin, limit);
  }
}

TEST(SessionOpen, ServersThatCannotBeReachedAreWaitedForOnlyBesideOneThatIsFull) {
  for (const bool any : {false, true}) {
    VirtualClock clock;
    FakeSession session(2, options(), clock);
    const absl::Time begin = clock.now();
    session.servers.unreachable = {1};
    if (!any) session.servers.unreachable.insert(0);
    session.servers.on_open = [&](size_t) {
      return session.servers.opens.size() < 2 ? full(1) : grpc::Status::OK;
    };
    const Outcome got = run(session, 3);
    EXPECT_EQ(got.status, any ? absl::OkStatus() : absl::UnavailableError("cannot reach"));
    EXPECT_EQ(got.events, any ? got.events : 4) << "a beginning and an end for each";
    EXPECT_EQ(clock.now() > begin, any);
  }
}

TEST(SessionOpen, ANameThatItsOwnLostCallMayHoldIsWaitedFor) {
  for (const bool own : {true, false}) {
    VirtualClock clock;
    FakeSession session(1, options(), clock);
    session.servers.on_open = [&](size_t) {
      const size_t opens = session.servers.opens.size();
      if (own && opens == 1) return kLost;
      return opens < 4 ? grpc::Status(grpc::ALREADY_EXISTS, "open on another call") : grpc::Status::OK;
    };
    EXPECT_EQ(run(session, 2).status,
              own ? absl::OkStatus() : absl::AlreadyExistsError("open on another call"));
    EXPECT_EQ(session.servers.opens.size(), own ? 4u : 1u);
  }
}

TEST(SessionOpen, AnOpenMessageThatComesTooLateIsSentAgain) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  session.servers.on_open = [&](size_t) {
    const bool late = session.servers.opens.size() < 3;
    return late ? grpc::Status(grpc::DEADLINE_EXCEEDED, "nothing arrived") : grpc::Status::OK;
  };
  EXPECT_OK(run(session, 2).status);
  EXPECT_EQ(session.servers.opens.size(), 3u);
}

}  // namespace
}  // namespace candela
