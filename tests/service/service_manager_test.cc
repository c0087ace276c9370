// candelad's messages to its service manager, and the end of its signs of life.
#include "server/daemon/service_manager.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstring>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "tests/support/clock.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"

namespace candela::testing {
namespace {

constexpr absl::Duration kSilence = absl::Seconds(60);

// systemd's end of the socket.
class Manager {
 public:
  explicit Manager(absl::Duration watchdog) {
    const std::string path = folder_.path("notify");
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, path.data(), path.size());
    socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    EXPECT_EQ(bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
    setenv("WATCHDOG_USEC", std::to_string(absl::ToInt64Microseconds(watchdog)).c_str(), 1);
  }
  ~Manager() {
    unsetenv("NOTIFY_SOCKET");
    unsetenv("WATCHDOG_USEC");
    close(socket_);
  }

  // Returns the next message's lines; none if it takes longer than `patience`.
  std::vector<std::string> next(absl::Duration patience = kSilence) {
    const timeval limit = absl::ToTimeval(patience);
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    char text[4096];
    const ssize_t size = recv(socket_, text, sizeof text, 0);
    if (size <= 0) return {};
    return absl::StrSplit(std::string(text, static_cast<size_t>(size)), '\n');
  }
  // Returns the next message that is not a sign of life.
  std::vector<std::string> next_event() {
    std::vector<std::string> lines = next();
    while (lines == std::vector<std::string>{"WATCHDOG=1"}) lines = next();
    return lines;
  }

 private:
  TemporaryFolder folder_;
  int socket_ = -1;
};

TEST(ServiceManager, HearsOfStartServiceLifeAndEnd) {
  constexpr absl::Duration kLimit = absl::Seconds(1);
  Manager manager(kLimit);
  Daemon daemon({"--listen", "127.0.0.1:0"});
  EXPECT_EQ(manager.next(), std::vector<std::string>{"STATUS=starting"});
  const std::vector<std::string> ready = manager.next();
  const std::string address = daemon.wait_until_listening();
  EXPECT_EQ(ready, (std::vector<std::string>{"READY=1", "STATUS=serving on " + address}));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(manager.next(), std::vector<std::string>{"WATCHDOG=1"}) << i;
  daemon.signal(SIGTERM);
  EXPECT_EQ(manager.next_event(), (std::vector<std::string>{"STOPPING=1", "STATUS=draining"}));
  EXPECT_EQ(daemon.wait(), 0) << daemon.errors();
}

TEST(ServiceManager, NoSocketAndNoWatchdogIsNothing) {
  tell_service_manager("READY=1");
  const Watchdog watchdog(real_clock(), [] {
    ADD_FAILURE() << "nobody wants to know";
    return true;
  });
}

TEST(Watchdog, GivesNoSignWhileThereIsNoLife) {
  constexpr absl::Duration kLimit = absl::Minutes(2);
  Manager manager(kLimit);
  VirtualClock clock;
  std::atomic<bool> alive = true;
  const Watchdog watchdog(clock, [&alive] { return alive.load(); });
  const auto signs_in = [&](int ticks) {  // each is half of the limit
    clock.tick(kLimit / 2, ticks);
    clock.wait_for_waiters(1);
    int signs = 0;
    while (manager.next(absl::Milliseconds(1)) == std::vector<std::string>{"WATCHDOG=1"}) ++signs;
    return signs;
  };
  EXPECT_GE(signs_in(6), 6);
  alive = false;
  EXPECT_EQ(signs_in(6), 0);
  alive = true;
  EXPECT_EQ(signs_in(2), 2);
}

}  // namespace
}  // namespace candela::testing
