// Sessions of the client library whose servers die, stop, hang or drain: every frame's image comes once, in
// order, and is what it would have been.
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
#include "tests/service/daemon.h"
#include "tests/service/service_fixture.h"
#include "tests/service/session_run.h"
#include "tests/support/files.h"

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

  // Of three kinds, by turns.
  SessionOptions options(size_t kind, size_t first_server) const {
    SessionOptions options;
    options.servers = {addresses_[first_server], addresses_[1 - first_server]};
    if (kind % 3 == 1) options.lookahead = 2;
    if (kind % 3 == 2) options.settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
    return options;
  }

  // Runs `count` sessions at once, half of them on the first daemon, and calls `meanwhile` when each has some
  // results and all of them go on.
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

  // What the kinds come to undisturbed, on the second daemon.
  std::vector<SessionRun> undisturbed(const Film& film) const {
    std::vector<SessionRun> runs;
    for (size_t kind = 0; kind < 3; ++kind)
      runs.push_back(run_session(Session::open(options(kind, 1)), film));
    for (const SessionRun& run : runs) EXPECT_EQ(run.images.size(), film->size()) << run.status;
    return runs;
  }

  // Six sessions lose the first daemon, by `lose`, and go on on the second.
  void expect_that_all_go_on(const std::function<void()>& lose) {
    const Film film = make_film(60, 320, 180);
    const std::vector<SessionRun> expected = undisturbed(film);
    const std::vector<SessionRun> runs = run_sessions(6, film, lose);
    for (size_t i = 0; i < runs.size(); ++i) {
      SCOPED_TRACE(absl::StrCat("session ", i));
      EXPECT_TRUE(runs[i].status.ok()) << runs[i].status;
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

}  // namespace
}  // namespace candela::testing
