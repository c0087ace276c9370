#include "server/config.h"

#include <algorithm>
#include <optional>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/base/net/address.h"
#include "server/listen_address.h"
#include "server/option_table.h"
#include "server/vulkan/device.h"

namespace candela {
namespace {

absl::Status check_tls(const Config& config) {
  if (config.tls_cert.empty() != config.tls_key.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat("%s is given without %s; TLS needs both",
                                                      config.tls_cert.empty() ? "tls-key" : "tls-cert",
                                                      config.tls_cert.empty() ? "tls-cert" : "tls-key"));
  }
  if (!config.tls_client_ca.empty() && config.tls_cert.empty()) {
    return absl::InvalidArgumentError(
        "tls-client-ca is given without tls-cert and tls-key; only TLS can ask clients for certificates");
  }
  return absl::OkStatus();
}

// Port 0 picks another port each time.
bool is_picked(const std::string& address) {
  const std::optional<HostPort> at = parse_host_port(address);
  return at && at->port == 0;
}

// No two listeners can have one address.
absl::Status check_distinct(const Config& config) {
  for (auto address = config.listen.begin(); address != config.listen.end(); ++address) {
    if (is_picked(*address)) continue;
    if (std::find(config.listen.begin(), address, *address) != address) {
      return absl::InvalidArgumentError(
          absl::StrFormat("listen names %s twice; remove one of them", *address));
    }
    if (*address == config.metrics) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "metrics is '%s', and so is listen; choose another port for one of them", *address));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status check_config(const Config& config) {
  absl::Status status = check_ranges(config);
  status.Update(check_tls(config));
  if (!config.metrics.empty()) status.Update(check_metrics_address(config.metrics, config.insecure));
  for (const std::string& address : config.listen) {
    status.Update(check_listen_address(address, config.insecure || !config.tls_cert.empty()));
  }
  status.Update(check_distinct(config));
  if (absl::EqualsIgnoreCase(config.device, kHostDevice) && config.executor == ExecutorKind::kDevice) {
    status.Update(absl::InvalidArgumentError(
        "device is host and executor is device; a server without a Vulkan device takes auto or host"));
  }
  return status;
}

}  // namespace candela
