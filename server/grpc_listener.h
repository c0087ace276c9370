// A gRPC server that listens on the configured addresses.
#pragma once

#include <grpcpp/server.h>

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/accept_loop.h"
#include "server/access/access.h"
#include "server/base/clock.h"
#include "server/base/metrics.h"
#include "server/config.h"
#include "server/own_door.h"
#include "server/session/memory/memory_door.h"

namespace candela {

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
