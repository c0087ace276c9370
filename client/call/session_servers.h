// The servers of a session, as its driver sees them.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "absl/time/time.h"
#include "client/call/client_call.h"
#include "client/environment.h"

namespace candela {

// Servers are counted from 0. Used by one thread.
class SessionServers {
 public:
  virtual ~SessionServers() = default;

  virtual size_t count() const = 0;
  virtual const std::string& address(size_t server) const = 0;

  // Begins a Stream call of the session with this name.
  virtual std::unique_ptr<ClientCall> call(size_t server, const std::string& session) = 0;

  // Puts the panorama on the server. SessionDriver::on_put() gets the answer, not before this returns.
  virtual void put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time deadline) = 0;
};

}  // namespace candela
