// The server that a command uses: a running one, or one that is started inside of this process.
#pragma once

#include <future>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/cli/commands/embedded_server.h"
#include "client/cli/options/options.h"
#include "client/connection.h"
#include "client/session.h"

namespace candela {

// Used by one thread.
class ServerLink {
 public:
  // A server of our own begins to start, on a thread of its own, so that files can be read meanwhile.
  explicit ServerLink(const ServerChoice& choice);
  ~ServerLink() { close(); }
  ServerLink(const ServerLink&) = delete;
  ServerLink& operator=(const ServerLink&) = delete;

  // Waits until a server of our own has started. Valid until close(). A malformed address is a usage error.
  absl::StatusOr<const Connection*> connection();

  // Opens a session there, or on one of the choice's others; `options.servers` is not looked at. Several at
  // once are possible, and none may outlive close().
  absl::StatusOr<Session> open_session(const SessionOptions& options);

  // What it is. Waits as connection() does, and then for a while. One of the others is asked where the first
  // is not there.
  absl::StatusOr<v1::GetServerInfoResponse> info();

  // What it accepts. A running server is asked; our own is not waited for.
  absl::StatusOr<v1::Limits> limits();

  // A usage error when the server does not know that tier; "" is its default and not asked about.
  absl::Status check_tier(const std::string& tier);

  // What it took to start a server of our own; 0 for a running one.
  double start_ms() const { return start_ms_; }

  // Stops a server of our own and gives up its memory.
  void close();

 private:
  using Started = absl::StatusOr<std::unique_ptr<EmbeddedServer>>;

  // Of running servers.
  std::vector<std::string> addresses() const;

  const ServerChoice choice_;
  std::future<Started> starting_;
  std::unique_ptr<EmbeddedServer> server_;
  std::vector<Connection> connections_;  // the first one's, then the choice's others'
  double start_ms_ = 0;
};

}  // namespace candela
