// A whole server inside of this process: the client's one door into server/.
#pragma once

#include <grpcpp/channel.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace candela {

class Server;

// Any thread.
class EmbeddedServer {
 public:
  // Sets the driver's environment. Call before start() if that runs beside other threads; those may read it.
  static void prepare();

  // Takes hundreds of milliseconds. `device` as candelad's --device.
  static absl::StatusOr<std::unique_ptr<EmbeddedServer>> start(const std::string& device);
  ~EmbeddedServer();

  // Not to be used after the server is gone.
  std::shared_ptr<grpc::Channel> channel() const;

 private:
  explicit EmbeddedServer(std::unique_ptr<Server> server);
  std::unique_ptr<Server> server_;
};

}  // namespace candela
