// The servers of a session at the ends of gRPC's channels.
#pragma once

#include <grpcpp/channel.h>

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/call/call_queue.h"
#include "client/call/session_servers.h"
#include "client/security.h"
#include "client/session_driver.h"

namespace candela {

struct SessionServer {
  std::shared_ptr<grpc::Channel> channel;
  Peer peer;
};

// One thread uses it; any thread may call wake().
class ChannelServers final : public SessionServers {
 public:
  explicit ChannelServers(std::vector<SessionServer> servers);

  size_t count() const override { return servers_.size(); }
  const std::string& address(size_t server) const override { return servers_[server].peer.address; }
  std::unique_ptr<ClientCall> call(size_t server, const std::string& session) override;
  void put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time deadline) override;

  // Waits for the next event, and gives it to the driver.
  void pass_on(SessionDriver& driver);
  // The driver gets CallEvent::kWoken.
  void wake() { queue_.wake(); }

 private:
  const std::vector<SessionServer> servers_;
  std::function<absl::StatusOr<v1::Environment>()> put_;  // pass_on() calls it next; null: nothing to put
  CallQueue queue_;
};

}  // namespace candela
