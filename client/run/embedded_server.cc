#include "client/run/embedded_server.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "client/run/options.h"
#include "server/alarm_timers.h"
#include "server/base/clock.h"
#include "server/base/process.h"
#include "server/base/status_macros.h"
#include "server/config.h"
#include "server/memory_budget.h"
#include "server/server.h"

namespace candela {

struct ServerTime {
  RealClock clock;
  AlarmTimers timers;
};

void EmbeddedServer::prepare() { prepare_driver_environment(); }

uint64_t EmbeddedServer::usable_memory_bytes() {
  const auto pages = static_cast<uint64_t>(std::max(sysconf(_SC_PHYS_PAGES), 1L));
  uint64_t bytes = pages * static_cast<uint64_t>(std::max(sysconf(_SC_PAGESIZE), 1L));
  bytes = std::min(bytes, read_cgroup_limits().memory_bytes.value_or(bytes));
  for (const auto resource : {RLIMIT_AS, RLIMIT_DATA}) {
    rlimit limit{};
    if (getrlimit(resource, &limit) == 0) bytes = std::min<uint64_t>(bytes, limit.rlim_cur);  // or infinity
  }
  return bytes;
}

std::vector<std::string> EmbeddedServer::daemon_variables() { return variable_names(); }

absl::StatusOr<std::unique_ptr<EmbeddedServer>> EmbeddedServer::start(const ServerChoice& choice) {
  Config config;
  if (!choice.executor.empty()) {
    ASSIGN_OR_RETURN(config.executor, parse_executor(choice.executor));
  }
  config.device = choice.device;
  config.host_without_gpu = !choice.bakes && config.executor != ExecutorKind::kDevice;
  config.memory_budget_bytes = kDefaultMemoryBudgetBytes;
  // Its one client may bring the largest panorama.
  config.environment_budget_bytes = kDefaultMemoryBudgetBytes / 2;
  std::unique_ptr<EmbeddedServer> embedded(new EmbeddedServer());
  ASSIGN_OR_RETURN(embedded->server_, Server::start(config, embedded->time_->clock, embedded->time_->timers));
  return embedded;
}

EmbeddedServer::EmbeddedServer() : time_(std::make_unique<ServerTime>()) {}

EmbeddedServer::~EmbeddedServer() = default;

std::shared_ptr<grpc::Channel> EmbeddedServer::channel() const { return server_->in_process_channel(); }

}  // namespace candela
