#include "absl/time/clock.h"
#include "client/cli/commands/commands.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/usage.h"
#include "client/connection.h"

namespace candela {

absl::Status run_health(const HealthOptions& options) {
  const absl::StatusOr<Connection> server = Connection::open(options.server.address, options.server.security);
  if (!server.ok()) return usage_error(std::string(server.status().message()));
  if (absl::Status status = server->health(absl::Now() + options.timeout); !status.ok()) return status;
  return print("SERVING\n");
}

}  // namespace candela
