// The one door into the server: candelad opens it, and so does a program that renders without a daemon.
#pragma once

#include <grpcpp/channel.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/config.h"

namespace candela {

// A device, its texture pool and renderer, and the service before them. Any thread.
class Server {
 public:
  // Opens the device, renders the self-test frame against the reference, listens where `config` says, and
  // serves. Sets the driver's environment (see server/base/driver_environment.h), so the first one of a
  // process is started before other threads read the environment. Fails in one line that says what to do.
  //
  // A device that is lost fails the frames that were on it with UNAVAILABLE and is opened anew.
  // `on_device_gone` is called once, on a thread that is not to be held, when that does not help any more:
  // every frame fails then.
  static absl::StatusOr<std::unique_ptr<Server>> start(const Config& config,
                                                       std::function<void()> on_device_gone = {});

  // Stops at once when drain_and_stop was not called.
  ~Server();

  // A channel that needs no socket. Not to be used after the server stopped.
  std::shared_ptr<grpc::Channel> in_process_channel();

  // Where it listens, with the ports that were taken for port 0; empty when nowhere.
  const std::vector<std::string>& addresses() const;

  // Where it serves metrics, with the port that was taken for port 0; empty when nowhere.
  const std::string& metrics_address() const;

  // Whether the render thread moves, as the health service's "liveness" says.
  bool alive() const;

  // The device's own name.
  const std::string& device_name() const;

  // Warnings and errors that Vulkan's validation layers have reported, where the config turned them on.
  uint64_t validation_messages() const;

  // For tests: the device is lost, and so are those that replace it, `times` in all.
  void lose_device(int times = 1);

  // Health says NOT_SERVING; config.pre_drain later, or at once without a device, new calls get UNAVAILABLE,
  // and frames in flight have config.drain_timeout to finish, then their calls are cancelled. `on_drained` is
  // called when none is in flight any more, unless that took too long; then connections are closed. Returns
  // when nothing runs any more. Once.
  void drain_and_stop(const std::function<void()>& on_drained = {});

 private:
  struct Parts;
  explicit Server(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

}  // namespace candela
