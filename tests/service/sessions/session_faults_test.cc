// Sessions of the client library whose servers die, stop, hang or drain. Every frame's image arrives once and
// in order, and is the same as without the fault.
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <memory>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/session_run.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

// Two daemons that know each other's tokens.
class SessionFaults : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string keys = folder_.path("keys");
    write_file(keys, "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n");
    ASSERT_EQ(chmod(keys.c_str(), S_IRUSR), 0);
    for (int i = 0; i < 2; ++i) {
      daemons_.push_back(std::make_unique<Daemon>(
          std::vector<std::string>{"--listen", "127.0.0.1:0", "--resume-keys", keys}));
      addresses_.push_back(daemons_[i]->wait_until_listening());
      ASSERT_NE(addresses_[i], "") << daemons_[i]->errors();
    }
  }

  // The sessions alternate between three kinds.
  SessionOptions options(size_t kind, size_t first_server) const {
    SessionOptions options;
    options.servers = {addresses_[first_server], addresses_[1 - first_server]};
    if (kind % 3 == 1) options.lookahead = 2;
    if (kind % 3 == 2) options.settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
    return options;
  }

  // Runs `count` sessions at once, half of them on the first daemon. Calls `meanwhile` when each has some
  // results and all are still running.
  std::vector<SessionRun> run_sessions(size_t count, const Film& film,
                                       const std::function<void()>& meanwhile) {
    std::vector<SessionRun> runs(count);
    std::vector<std::thread> clients;
    std::atomic<size_t> going = 0;
    absl::Notification all_going;
    for (size_t i = 0; i < count; ++i) {
      clients.emplace_back([&, i] {
        runs[i] = run_session(Session::open(options(i, i < count / 2 ? 0 : 1)), film, [&](size_t results) {
          if (results != kSome) return;
          ++going;
          all_going.WaitForNotification();
        });
      });
    }
    const absl::Time limit = absl::Now() + absl::Minutes(2);
    while (going < count && absl::Now() < limit) absl::SleepFor(absl::Milliseconds(1));
    all_going.Notify();
    absl::SleepFor(absl::Milliseconds(20));
    meanwhile();
    for (std::thread& client : clients) client.join();
    return runs;
  }

  // The undisturbed results of each kind, from the second daemon.
  std::vector<SessionRun> undisturbed(const Film& film) const {
    std::vector<SessionRun> runs;
    for (size_t kind = 0; kind < 3; ++kind)
      runs.push_back(run_session(Session::open(options(kind, 1)), film));
    for (const SessionRun& run : runs) EXPECT_EQ(run.images.size(), film->size()) << run.status;
    return runs;
  }

  // `lose` makes six sessions lose the first daemon. They continue on the second.
  void expect_that_all_go_on(const std::function<void()>& lose) {
    const Film film = make_film(60, 320, 180);
    const std::vector<SessionRun> expected = undisturbed(film);
    const std::vector<SessionRun> runs = run_sessions(6, film, lose);
    for (size_t i = 0; i < runs.size(); ++i) {
      SCOPED_TRACE(absl::StrCat("session ", i));
      EXPECT_OK(runs[i].status);
      EXPECT_TRUE(runs[i].images == expected[i % 3].images);
      EXPECT_EQ(runs[i].stats.resumes, i < 3 ? 1u : 0u) << runs[i].stats.last_loss;
      EXPECT_EQ(runs[i].stats.server, addresses_[1]);
    }
  }

  static constexpr size_t kSome = 6;
  const TemporaryFolder folder_;
  std::vector<std::unique_ptr<Daemon>> daemons_;
  std::vector<std::string> addresses_;
};

TEST_F(SessionFaults, AKilledDaemonCostsSixSessionsNoFrameAndNoBit) {
  expect_that_all_go_on([&] {
    daemons_[0]->signal(SIGKILL);
    EXPECT_EQ(daemons_[0]->wait(), -SIGKILL);
  });
}

TEST_F(SessionFaults, ADrainingDaemonEndsWithZeroAndEveryFrameComesOnce) {
  expect_that_all_go_on([&] {
    daemons_[0]->signal(SIGTERM);
    EXPECT_EQ(daemons_[0]->wait(), 0) << daemons_[0]->errors();
  });
}

// The kernel of the stopped daemon still accepts data.
TEST_F(SessionFaults, AStoppedDaemonIsLeftWhenItGivesNoSignOfLife) {
  const Film film = make_film(30, 320, 180);
  const SessionRun expected = run_session(Session::open(options(0, 1)), film);
  SessionOptions stopped = options(0, 0);
  stopped.ping_interval = absl::Seconds(1);
  const absl::Time begin = absl::Now();
  const SessionRun run = run_session(Session::open(stopped), film, [&](size_t results) {
    if (results == kSome) daemons_[0]->signal(SIGSTOP);
  });
  EXPECT_LT(absl::Now() - begin, stopped.silence_limit);
  EXPECT_OK(run.status);
  EXPECT_TRUE(run.images == expected.images);
  EXPECT_EQ(run.stats.resumes, 1u);
  EXPECT_EQ(run.stats.server, addresses_[1]);
  daemons_[0]->signal(SIGCONT);
  EXPECT_TRUE(wait_until_idle(*Connection::open(addresses_[0]))) << "the session that left was kept";
  daemons_[0]->signal(SIGTERM);
  EXPECT_EQ(daemons_[0]->wait(), 0) << daemons_[0]->errors();
}

// One ping a second on an otherwise idle connection.
TEST_F(SessionFaults, ADaemonTakesThePingsOfASessionThatWaits) {
  SessionOptions waiting = options(0, 0);
  waiting.ping_interval = absl::Seconds(1);
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(waiting));
  absl::SleepFor(absl::Seconds(8));
  EXPECT_EQ(session.stats().resumes, 0u) << session.stats().last_loss;
  const Film film = make_film(3, 64, 48);
  const SessionRun run = run_session(std::move(session), film);
  EXPECT_OK(run.status);
  EXPECT_EQ(run.images.size(), film->size());
  EXPECT_EQ(run.stats.resumes, 0u) << run.stats.last_loss;
}

// Frames that look-ahead holds back are not due.
TEST_F(SessionFaults, LookAheadThatWaitsForFramesIsNoSilence) {
  SessionOptions waiting = options(1, 0);
  waiting.silence_limit = absl::Seconds(2);
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(waiting));
  const Film film = make_film(5, 64, 48);
  for (size_t i = 0; i < film->size(); ++i) {
    if (i == waiting.lookahead) absl::SleepFor(absl::Seconds(4));
    ASSERT_OK(session.submit(frame_of(film, i)));
  }
  session.finish();
  for (size_t i = 0; i < film->size(); ++i) ASSERT_TRUE(session.next_result()->has_value());
  EXPECT_EQ(session.stats().resumes, 0u) << session.stats().last_loss;
}

}  // namespace
}  // namespace candela::testing
