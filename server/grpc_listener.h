// A gRPC server that listens on the configured addresses.
#pragma once

#include <grpcpp/server.h>

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/access/access.h"
#include "server/base/metrics.h"
#include "server/config.h"

namespace candela {

struct GrpcListener {
  std::unique_ptr<grpc::Server> server;
  std::vector<std::string> addresses;  // as configured, but with the port that was picked for port 0
};

// Starts `service` with health checks and reflection. UNAVAILABLE if it cannot listen on an address.
// `access`, `metrics` and `service` must outlive the server.
absl::StatusOr<GrpcListener> start_grpc(const Config& config, Access& access, Metrics& metrics,
                                        grpc::Service& service);

}  // namespace candela
