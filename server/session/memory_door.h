// Takes the connections of the `.memory` sockets, at which clients register regions: docs/transport.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/base/clock.h"
#include "server/session/memory_region.h"

namespace candela {

// One thread serves all of them and waits for none. Beyond `max_connections` the newest is closed.
class MemoryDoor {
 public:
  struct Options {
    size_t max_connections = 0;
    absl::Duration hello_limit;  // until a client has sent its region
  };

  // `regions` and `timers` outlive it. Memory is counted by `claim`, on the thread.
  MemoryDoor(MemoryRegions& regions, Timers& timers, const Options& options, MemoryRegion::Claim claim);
  // Closes every connection. Regions stay as long as frames use them.
  ~MemoryDoor();
  MemoryDoor(const MemoryDoor&) = delete;
  MemoryDoor& operator=(const MemoryDoor&) = delete;

  // Serves a connection that was accepted, and owns its descriptor, which does not block. Any thread.
  void take(int descriptor);

  size_t connections() const;  // any thread

 private:
  struct Connection {
    std::string ticket;            // empty: it has not sent its region
    std::shared_ptr<bool> late;    // its time for that is over
    std::unique_ptr<Timer> timer;  // sets it
  };
  // What timers use, which may run when this is gone.
  struct Wake;

  void run();
  void admit();
  // Returns whether the connection goes on.
  bool serve(int descriptor, Connection& connection);
  void end(int descriptor);

  MemoryRegions& regions_;
  Timers& timers_;
  const Options options_;
  const MemoryRegion::Claim claim_;
  const std::shared_ptr<Wake> wake_;
  std::map<int, Connection> open_;  // the thread's, by descriptor
  std::thread thread_;              // last: it uses all of the above
};

}  // namespace candela
