// `candela health`: whether a server is ready.
#include <CLI/App.hpp>
#include <memory>

#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/terminal.h"
#include "client/connection.h"
#include "server/base/address.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

absl::Status run_health(const HealthOptions& options) {
  const absl::StatusOr<Connection> server = Connection::open(options.server.address, options.server.security);
  if (!server.ok()) return usage_error(std::string(server.status().message()));
  RETURN_IF_ERROR(server->health(absl::Now() + options.timeout));
  return print("SERVING\n");
}

constexpr char kHealthExamples[] =
    "Examples:\n"
    "  candela health\n"
    "  candela health --server render.example:50051 --tls-ca ca.pem --timeout 1";

Finish define_health(CLI::App& app) {
  const auto options = std::make_shared<HealthOptions>();
  add_running_server_option(app, "Options", options->server);
  add_security_options(app, "Options", options->server.security);
  add_number(app, "Options", "--timeout", "SECONDS", {0.001, 3600}, absl::ToDoubleSeconds(options->timeout),
             "How long to wait for an answer",
             [options](double seconds) { options->timeout = absl::Seconds(seconds); });
  return [options](const GivenOptions&) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_server_options(options->server));
    if (options->server.address.empty()) {
      options->server.address = kDefaultAddress;
      options->server.source = "candelad's default; --server names another";
    }
    ParsedCommand health = parsed_command(*options, run_health);
    health.is_probe = true;
    return health;
  };
}

}  // namespace

const Command kHealthCommand{
    "health", "Checks whether a server is serving: exit code 0 if so, 1 if not, 2 for wrong usage.",
    kHealthExamples, define_health};

}  // namespace candela
