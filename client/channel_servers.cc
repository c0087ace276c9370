#include "client/channel_servers.h"

#include <utility>

#include "client/call/duplex_call.h"
#include "client/connection.h"

namespace candela {

ChannelServers::ChannelServers(std::vector<SessionServer> servers) : servers_(std::move(servers)) {}

std::unique_ptr<ClientCall> ChannelServers::call(size_t server, const std::string& session) {
  const auto& [channel, peer] = servers_[server];
  return std::make_unique<DuplexCall>(queue_, channel, peer, "/candela.v1.RenderService/Stream",
                                      DuplexCall::Metadata{{"x-session-id", session}});
}

void ChannelServers::put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time deadline) {
  put_ = [this, server, panorama = std::move(panorama), deadline] {
    const auto& [channel, peer] = servers_[server];
    return Connection(channel, peer).put_environment(*panorama, deadline);
  };
}

void ChannelServers::pass_on(SessionDriver& driver) {
  if (put_) return driver.on_put(std::exchange(put_, nullptr)());
  driver.on_event(queue_.next(driver.deadline()));
}

}  // namespace candela
