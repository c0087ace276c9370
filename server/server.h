// The entrance to the server. candelad uses it, and so does a program that renders without a daemon.
#pragma once

#include <grpcpp/channel.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/base/clock.h"
#include "server/config.h"

namespace candela {

// A device with its texture pool and renderer, and the gRPC service that renders with them. Any thread.
class Server {
 public:
  // Opens the device, compares a test frame with the reference, listens on the addresses in `config`, and
  // serves. Sets the driver's environment (see server/base/process.h), so start the first
  // server of a process before other threads read the environment. The error is one line and says what to do.
  //
  // When the device is lost, its frames fail with UNAVAILABLE and the device is reopened. If it is lost again
  // and again, or hangs, every frame fails from then on, and `on_device_gone` is called once. It must not
  // block its thread. After a hang the process should end by _exit, because the device never lets go of its
  // memory. `clock` and `timers` outlive the server.
  static absl::StatusOr<std::unique_ptr<Server>> start(const Config& config, Clock& clock, Timers& timers,
                                                       std::function<void()> on_device_gone = {});

  // Stops at once, unless drain_and_stop was called.
  ~Server();

  // A channel that needs no socket. Do not use it after the server has stopped.
  std::shared_ptr<grpc::Channel> in_process_channel();

  // The addresses that it listens on, with the port that was picked for port 0. Empty if there are none.
  const std::vector<std::string>& addresses() const;

  // The address that serves metrics, with the port that was picked for port 0. Empty if there is none.
  const std::string& metrics_address() const;

  // Whether the render thread makes progress: the health service's "liveness".
  bool alive() const;

  // The device's name, as Vulkan reports it, or "host".
  const std::string& device_name() const;

  // The number of warnings and errors from Vulkan's validation layers. 0 if the config does not enable them.
  uint64_t validation_messages() const;

  // For tests: loses the device and its replacements, `times` devices in all.
  void lose_device(int times = 1);
  // For tests: the device allocates nothing any more, and its driver does not call it lost.
  void refuse_device_memory();
  // For tests: the device does `submissions` more pieces of work, and hangs at the next one.
  void hang_device(int submissions = 0);
  // For tests: the render thread calls `work` next, and renders nothing until it returns. UNAVAILABLE if the
  // server is stopping.
  absl::Status occupy_device(std::function<void()> work);
  // For tests: the frames that wait for the render thread.
  size_t frames_waiting() const;

  // Health says NOT_SERVING. After config.pre_drain, or at once if the device is gone, new calls get
  // UNAVAILABLE. Frames in flight then have config.drain_timeout to finish before their calls are cancelled.
  // `on_drained` is called when no frame is in flight any more, unless the time ran out. Then connections are
  // closed. Returns when all threads have stopped. Call it once.
  void drain_and_stop(const std::function<void()>& on_drained = {});

 private:
  struct Impl;
  explicit Server(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace candela
