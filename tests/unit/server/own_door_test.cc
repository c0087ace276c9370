#include "server/own_door.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <thread>

#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "server/accept_loop.h"
#include "server/base/net/listening_socket.h"

namespace candela {
namespace {

constexpr OwnDoor::Options kQuick{.interval = absl::Milliseconds(50),
                                  .limit = absl::Milliseconds(200),
                                  .dead_limit = absl::Milliseconds(400)};

// What an OwnDoor reports last.
class Reports {
 public:
  void add(OwnDoor::State state) {
    const absl::MutexLock lock(&mutex_);
    last_ = state;
  }
  bool becomes(bool answers, bool alive) {
    const absl::MutexLock lock(&mutex_);
    const auto so = [&] { return last_ == OwnDoor::State{answers, alive}; };
    return mutex_.AwaitWithTimeout(absl::Condition(&so), absl::Seconds(10));
  }

 private:
  absl::Mutex mutex_;
  OwnDoor::State last_;
};

ListeningSocket listen() { return std::move(ListeningSocket::listen("listen", "127.0.0.1:0")->front()); }

// The kernel completes connections that nobody accepts, so connecting alone proves nothing.
TEST(OwnDoor, ASocketThatNobodyAcceptsIsDeafUntilSomebodyAnswers) {
  const ListeningSocket socket = listen();
  Reports reports;
  const OwnDoor door({{socket.local(), false}}, kQuick, [&](OwnDoor::State state) { reports.add(state); });
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
  const ListeningSocket socket = listen();
  Reports reports;
  const OwnDoor door({{socket.local(), false}}, kQuick, [&](OwnDoor::State state) { reports.add(state); });
  EXPECT_TRUE(reports.becomes(false, false));
  int checks = 0;
  for (pollfd wait{socket.descriptor(), POLLIN, 0}; poll(&wait, 1, 0) > 0; ++checks) {
    close(accept(socket.descriptor(), nullptr, nullptr));
  }
  EXPECT_GE(checks, 4);
  EXPECT_LE(checks, 6);  // the next one may have begun
}

TEST(OwnDoor, AnAddressWithoutASocketIsDeaf) {
  std::optional<ListeningSocket> socket(listen());
  const sockaddr_storage at = socket->local();
  socket.reset();
  Reports reports;
  const OwnDoor door({{at, true}}, kQuick, [&](OwnDoor::State state) { reports.add(state); });
  EXPECT_TRUE(reports.becomes(false, false));
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
