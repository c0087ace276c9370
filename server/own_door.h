// Checks that a server answers those who connect to it.
#pragma once

#include <openssl/ssl.h>
#include <sys/socket.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "absl/time/time.h"
#include "server/base/clock.h"
#include "server/base/stop_sign.h"

namespace candela {

// A thread connects to each of the server's own addresses as a client does: it begins HTTP/2, or TLS, and
// waits for the first bytes. Connecting alone proves nothing, because the kernel does that. A connection that
// is closed without an answer was accepted, too: the server has as many as it takes. If this process has no
// descriptor for the attempt, it has none for a client either.
class OwnDoor {
 public:
  struct Address {
    sockaddr_storage at{};
    bool tls = false;
  };
  struct Options {
    absl::Duration interval = absl::Seconds(5);  // between checks, and the time for an answer
    // Without an answer for `limit`, State::answers becomes false; without one for `dead_limit`,
    // State::alive, too.
    absl::Duration limit = absl::Seconds(30);
    absl::Duration dead_limit = absl::Minutes(2);
  };
  struct State {
    bool answers = true;
    bool alive = true;
    bool operator==(const State&) const = default;
  };

  // `report` is called on the thread when the state changes from good, or later changes again. Time counts in
  // checks and the time allowed for their answers, so that a process that was suspended for a while is not
  // deaf. `clock` outlives it.
  OwnDoor(std::vector<Address> addresses, Clock& clock, const Options& options,
          std::function<void(State)> report);
  ~OwnDoor();
  OwnDoor(const OwnDoor&) = delete;
  OwnDoor& operator=(const OwnDoor&) = delete;

 private:
  void run();
  bool answers(const Address& address);
  // True if one of `events` happens in time. Gives up when the thread shall end.
  bool wait_for(int connection, int16_t events, absl::Time end);

  const std::vector<Address> addresses_;
  Clock& clock_;
  const Options options_;
  const std::function<void(State)> report_;
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> tls_;
  StopSign stop_;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace candela
