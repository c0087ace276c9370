// Accepts connections for gRPC, which itself (1.51) accepts any number of them and stops for good when there
// is no descriptor left.
#pragma once

#include <sys/stat.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "server/base/clock.h"
#include "server/base/metrics.h"
#include "server/base/net/listening_socket.h"
#include "server/base/net/rate_limit.h"

namespace candela {

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

}  // namespace candela
