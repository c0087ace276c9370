// How connections reach gRPC: the accept loop, the check of one's own door, and the listener.
#pragma once

#include <grpcpp/server.h>
#include <openssl/ssl.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/access/access.h"
#include "server/base/clock.h"
#include "server/base/listening_socket.h"
#include "server/base/metrics.h"
#include "server/config.h"
#include "server/session/memory_door.h"

namespace candela {

// Checks that a server answers those who connect to it.
//
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

// Accepts connections for gRPC, which itself (1.51) accepts any number of them and stops for good when there
// is no descriptor left.

// The connections that were accepted and that gRPC has not closed yet. gRPC does not say when it closes one,
// so this remembers each descriptor with its inode: a descriptor that is closed, or open as something else,
// is gone. Any thread.
class OpenConnections {
 public:
  void add(int descriptor, std::string client = {});
  // Forgets those that are gone, and returns the number of the others.
  size_t count();
  // Whether one of `client`'s was added and not forgotten.
  bool has(const std::string& client) const;
  // Forgets those that are gone. Each client of the others once, in ascending order.
  std::set<std::string> clients();

 private:
  struct Known {
    int descriptor;
    ino_t inode;
    std::string client;
  };
  void forget_closed() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  mutable absl::Mutex mutex_;
  std::vector<Known> known_ ABSL_GUARDED_BY(mutex_);
  size_t look_at_ = 64;  // with this many known ones, add() forgets those that are gone
};

// One thread accepts. Beyond `max_connections`, or without a descriptor, the newest connection is closed at
// once; that is counted, and logged once a second at most.
class AcceptLoop {
 public:
  struct Door {
    ListeningSocket socket;
    std::function<void(int)> take;  // takes an accepted connection and owns it
  };

  // `connections`, `metrics` and `clock` outlive it.
  AcceptLoop(std::vector<Door> doors, size_t max_connections, OpenConnections& connections, Metrics& metrics,
             Clock& clock);
  // Closes the doors. Connections stay as they are.
  ~AcceptLoop();
  AcceptLoop(const AcceptLoop&) = delete;
  AcceptLoop& operator=(const AcceptLoop&) = delete;

 private:
  void run();
  // Returns false if this door has nothing to accept.
  bool accept_one(const Door& door);
  void accept_without_descriptor(const Door& door);
  void refuse(int descriptor, ConnectionRefusal reason);
  bool is_full();

  std::vector<Door> doors_;
  const size_t max_connections_;
  OpenConnections& connections_;
  Metrics& metrics_;
  Clock& clock_;
  size_t at_most_ = 0;  // no more are open: the last count and what was accepted since
  OneASecond lines_;
  int spare_;           // a descriptor that is given up to accept and close a connection
  const int stop_;      // becomes readable when the thread shall end
  std::thread thread_;  // last: it uses all of the above
};

// A gRPC server that listens on the configured addresses.

// Destroy `accepting`, which closes the addresses, before the server shuts down.
struct GrpcListener {
  std::unique_ptr<grpc::Server> server;
  std::unique_ptr<AcceptLoop> accepting;    // null if there are no addresses
  std::vector<std::string> addresses;       // as configured, but with the port that was picked for port 0
  std::vector<OwnDoor::Address> own_doors;  // where this process reaches them
};

// The time for a connection's first bytes.
absl::Duration handshake_limit(const Config& config);

// Starts `service` with health checks and reflection, and takes at most `max_connections`. UNAVAILABLE if it
// cannot listen on an address.
// `connections`, `access`, `metrics`, `service` and `clock` must outlive the server. `memory`, if it is not
// null, gets the connections of a `.memory` socket beside each unix socket, and outlives `accepting`; an
// address for which there can be no such socket is logged, and goes without.
absl::StatusOr<GrpcListener> start_grpc(const Config& config, uint32_t max_connections,
                                        OpenConnections& connections, Access& access, Metrics& metrics,
                                        grpc::Service& service, Clock& clock, MemoryDoor* memory = nullptr);

}  // namespace candela
