// The built-in server: a whole candela server in this process. Only this file and its .cc open the door to
// the server, server/server.h.
#pragma once

#include <grpcpp/channel.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace candela {

class Server;
struct ServerChoice;
struct ServerTime;

// Usable from any thread.
class EmbeddedServer {
 public:
  // Sets the environment variables of the Vulkan driver. Call it before
  // other threads start, because they may read the environment.
  static void prepare();

  // The bytes of memory that this process may use: the machine's, the limit of its control group, and its own
  // (ulimit -v, ulimit -d), whichever is least.
  static uint64_t usable_memory_bytes();

  // The environment variables that candelad reads.
  static std::vector<std::string> daemon_variables();

  // Takes tens of milliseconds, and hundreds with a Vulkan device.
  static absl::StatusOr<std::unique_ptr<EmbeddedServer>> start(const ServerChoice& choice);
  ~EmbeddedServer();

  // Do not use the channel after this object is destroyed.
  std::shared_ptr<grpc::Channel> channel() const;

 private:
  EmbeddedServer();
  const std::unique_ptr<ServerTime> time_;
  std::unique_ptr<Server> server_;
};

}  // namespace candela
