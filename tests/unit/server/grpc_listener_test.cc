#include "server/grpc_listener.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "server/base/listening_socket.h"
#include "tests/support/clock.h"

namespace candela {
namespace {

using testing::real_clock;
using testing::VirtualClock;

constexpr OwnDoor::Options kQuick{.interval = absl::Milliseconds(50),
                                  .limit = absl::Milliseconds(200),
                                  .dead_limit = absl::Milliseconds(400)};

// What an OwnDoor reports.
class DoorReports {
 public:
  void add(OwnDoor::State state) {
    const absl::MutexLock lock(&mutex_);
    all_.push_back(state);
  }
  OwnDoor::State last() {
    const absl::MutexLock lock(&mutex_);
    return all_.empty() ? OwnDoor::State() : all_.back();
  }
  // Passes over what was reported before that, which may have been for a moment.
  bool becomes(bool answers, bool alive) {
    const absl::MutexLock lock(&mutex_);
    const auto so = [&] {
      const auto found = std::find(all_.begin() + seen_, all_.end(), OwnDoor::State{answers, alive});
      seen_ = found - all_.begin();
      return found != all_.end();
    };
    return mutex_.AwaitWithTimeout(absl::Condition(&so), absl::Minutes(1));
  }

 private:
  absl::Mutex mutex_;
  std::vector<OwnDoor::State> all_;
  std::ptrdiff_t seen_ = 0;
};

ListeningSocket listen() { return std::move(ListeningSocket::listen("listen", "127.0.0.1:0")->front()); }

// In real time. The kernel completes connections that nobody accepts, so connecting alone proves nothing.
TEST(OwnDoor, ASocketThatNobodyAcceptsIsDeafUntilSomebodyAnswers) {
  const ListeningSocket socket = listen();
  DoorReports reports;
  const OwnDoor door({{socket.local(), false}}, real_clock(), kQuick,
                     [&](OwnDoor::State state) { reports.add(state); });
  EXPECT_TRUE(reports.becomes(false, true));
  EXPECT_TRUE(reports.becomes(false, false));
  std::atomic<bool> stop = false;
  std::thread server([&] {
    while (!stop) {
      pollfd wait{socket.descriptor(), POLLIN, 0};
      if (poll(&wait, 1, 20) <= 0) continue;
      const int connection = accept(socket.descriptor(), nullptr, nullptr);
      char preface[24];
      EXPECT_EQ(recv(connection, preface, sizeof preface, MSG_WAITALL), 24);
      EXPECT_EQ(send(connection, "\0\0\0\4\0\0\0\0", 9, MSG_NOSIGNAL), 9);
      close(connection);
    }
  });
  EXPECT_TRUE(reports.becomes(true, true));
  stop = true;
  server.join();
}

// A check that gets no answer takes twice the interval, and all of that counts.
TEST(OwnDoor, TheTimeForAnAnswerCountsAsDeaf) {
  constexpr OwnDoor::Options kOptions;
  const ListeningSocket socket = listen();
  VirtualClock clock;
  DoorReports reports;
  const OwnDoor door({{socket.local(), false}}, clock, kOptions,
                     [&](OwnDoor::State state) { reports.add(state); });
  for (int check = 1; check <= 12; ++check) {
    clock.wait_for_waiters(1);
    clock.advance(kOptions.interval);
    pollfd wait{socket.descriptor(), POLLIN, 0};
    ASSERT_EQ(poll(&wait, 1, 10'000), 1);
    const int connection = accept(socket.descriptor(), nullptr, nullptr);  // closing it would be an answer
    clock.advance(kOptions.interval);
    clock.wait_for_waiters(1);
    close(connection);
    EXPECT_EQ(reports.last(), (OwnDoor::State{check < 3, check < 12})) << check;
  }
}

TEST(OwnDoor, AnAddressWithoutASocketIsDeaf) {
  constexpr OwnDoor::Options kOptions;
  std::optional<ListeningSocket> socket(listen());
  const sockaddr_storage at = socket->local();
  socket.reset();
  VirtualClock clock;
  DoorReports reports;
  const OwnDoor door({{at, true}}, clock, kOptions, [&](OwnDoor::State state) { reports.add(state); });
  for (int check = 1; check <= 24; ++check) {
    clock.tick(kOptions.interval);
    EXPECT_EQ(reports.last(), (OwnDoor::State{check < 6, check < 24})) << check;
  }
}

TEST(OpenConnections, ForgetsWhatIsClosedAndWhatIsOpenAsSomethingElse) {
  const ListeningSocket first = listen();
  const int second = dup(STDERR_FILENO);
  OpenConnections connections;
  const int pair = socket(AF_INET, SOCK_STREAM, 0);
  connections.add(first.descriptor());
  connections.add(pair);
  EXPECT_EQ(connections.count(), 2u);
  dup2(second, pair);  // the same number, another file
  EXPECT_EQ(connections.count(), 1u);
  close(pair);
  close(second);
  EXPECT_EQ(connections.count(), 1u);
}

TEST(OpenConnections, ASocketWithTheSameNumberIsAnotherConnection) {
  OpenConnections connections;
  const int first = socket(AF_INET, SOCK_STREAM, 0);
  connections.add(first);
  close(first);
  const int second = socket(AF_INET, SOCK_STREAM, 0);
  ASSERT_EQ(second, first);
  EXPECT_EQ(connections.count(), 0u);
  close(second);
}

}  // namespace
}  // namespace candela
