// A session's driver in virtual time and in one thread: faults at every event that a film has, and what it
// waits for. Nothing here waits in real time.
#include "client/session_driver.h"

#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "client/call/retry/retry_info.h"
#include "tests/support/status.h"
#include "tests/unit/client/fake_calls.h"

namespace candela {
namespace {

using testing::VirtualClock;

const grpc::Status kLost{grpc::UNAVAILABLE, "lost"};

v1::Settings at_ev(double ev) {
  v1::Settings settings;
  settings.mutable_exposure()->set_manual_ev(ev);
  return settings;
}

SessionFrame frame(uint64_t sequence) {
  static const std::vector<std::byte> pixel(8);
  return {.width = 1,
          .height = 1,
          .pixels = pixel,
          .sequence = sequence,
          .media_time_ns = static_cast<int64_t>(sequence) * 1000};
}

SessionOptions options() {
  SessionOptions options;
  options.settings = at_ev(1);
  options.resume_limit = absl::Seconds(5);
  options.silence_limit = absl::Minutes(1);
  return options;
}

// google.rpc.Status with a google.rpc.RetryInfo of so many seconds, up to 127.
grpc::Status full(int seconds) {
  const std::string type = "type.googleapis.com/google.rpc.RetryInfo";
  const std::string info{'\x0a', '\x02', '\x08', static_cast<char>(seconds)};
  const std::string any = "\x0a" + std::string(1, static_cast<char>(type.size())) + type + "\x12" +
                          std::string(1, static_cast<char>(info.size())) + info;
  return {grpc::UNAVAILABLE, "full", "\x08\x0e\x1a" + std::string(1, static_cast<char>(any.size())) + any};
}

struct Outcome {
  absl::Status status = absl::InternalError("it stands still");
  std::vector<int> values;  // a byte of each result, in the order they came
  int events = 0;           // that were passed on
  SessionStats stats;
};

// Submits `frames` frames, with an EV of 2 from frame `change` on, and takes their results. `before` is
// called before each event, with its number.
Outcome run(FakeSession& session, uint64_t frames, uint64_t change = 1000,
            const std::function<void(int event)>& before = nullptr) {
  Outcome run;
  session.driver.start();
  uint64_t next = 0;
  for (bool going = true, finished = false; going;) {
    while (session.state.was_open() && next < frames && session.state.ready()) {
      if (next == change && !session.state.change_settings(next, at_ev(2)).ok()) break;
      if (!session.state.submit(frame(next)).ok()) break;
      ++next;
    }
    if (next == frames && !finished) {
      finished = true;
      session.state.finish();
    }
    if (before) before(run.events);
    going = session.step();
    run.events += going;
    while (session.state.result_ready()) {
      const absl::StatusOr<std::optional<FrameResult>> result = session.state.next_result();
      run.status = result.status();
      if (!result.ok() || !*result) break;
      EXPECT_EQ((**result).sequence, run.values.size());
      run.values.push_back(static_cast<int>((**result).image.pixels().back()));
    }
  }
  run.stats = session.state.stats();
  EXPECT_TRUE(session.driver.ended());
  EXPECT_EQ(session.servers.call_now, nullptr);
  return run;
}

std::vector<int> expected(uint64_t frames, uint64_t change = 1000) {
  std::vector<int> values;
  for (uint64_t i = 0; i < frames; ++i) values.push_back(static_cast<int>((i >= change ? 32 : 16) + i));
  return values;
}

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

TEST(SessionDriver, AFullServerIsAskedWhenItSaysAndNotBefore) {
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

TEST(SessionDriver, AServerThatWantsToBeLeftAloneForTooLongIsNotAskedAgain) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  const absl::Time begin = clock.now();
  session.servers.on_frame = [](size_t, uint64_t) { return full(60); };
  EXPECT_REFUSED(kUnavailable, "for 5s: full", run(session, 5).status);
  EXPECT_EQ(session.servers.opens.size(), 1u);
  EXPECT_EQ(clock.now() - begin, absl::Seconds(5));
}

TEST(SessionDriver, AFullServerIsWaitedForBeforeTheFirstOpen) {
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

TEST(SessionDriver, TheFirstOpenHasALimitAndZeroMeansOnce) {
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

TEST(SessionDriver, ServersThatCannotBeReachedAreWaitedForOnlyBesideOneThatIsFull) {
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
