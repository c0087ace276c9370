#include "server/config.h"

#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/base/units.h"
#include "server/listen_address.h"

namespace candela {
namespace {

absl::Status check_bytes(const char* option, uint64_t value, v1::Range<uint64_t> range) {
  if (value >= range.min && value <= range.max) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("%s is %s; it must be %s .. %s", option,
                                                    format_bytes(value), format_bytes(range.min),
                                                    format_bytes(range.max)));
}

absl::Status check_number(const char* option, uint32_t value, v1::Range<uint32_t> range) {
  if (value >= range.min && value <= range.max) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s is %d; it must be %d .. %d", option, value, range.min, range.max));
}

absl::Status check_duration(const char* option, absl::Duration value, v1::Range<absl::Duration> range) {
  if (value >= range.min && value <= range.max) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s is %s; it must be %s .. %s", option, absl::FormatDuration(value),
                      absl::FormatDuration(range.min), absl::FormatDuration(range.max)));
}

absl::Status check_tls(const Config& config) {
  if (config.tls_cert.empty() != config.tls_key.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat("%s is given without %s; TLS needs both",
                                                      config.tls_cert.empty() ? "tls-key" : "tls-cert",
                                                      config.tls_cert.empty() ? "tls-cert" : "tls-key"));
  }
  if (!config.tls_client_ca.empty() && config.tls_cert.empty()) {
    return absl::InvalidArgumentError(
        "tls-client-ca is given without tls-cert and tls-key; only TLS asks clients for certificates");
  }
  return absl::OkStatus();
}

}  // namespace

std::string default_cache_dir() {
  const auto folder = [](const char* variable, const char* below) {
    const char* value = std::getenv(variable);
    return value != nullptr && *value == '/' ? absl::StrCat(value, below) : std::string();
  };
  const std::string cache = folder("XDG_CACHE_HOME", "/candela");
  return cache.empty() ? folder("HOME", "/.cache/candela") : cache;
}

absl::Status check_config(const Config& config) {
  absl::Status status;
  if (config.memory_budget_bytes != 0) {
    status.Update(check_bytes("memory-budget", config.memory_budget_bytes, kMemoryBudgetBytes));
  }
  status.Update(check_bytes("max-frame-bytes", config.max_frame_bytes, kMaxFrameBytes));
  status.Update(check_number("max-dimension", config.max_dimension, kMaxDimension));
  status.Update(check_number("max-calls", config.max_calls, kMaxCalls));
  status.Update(check_number("max-sessions", config.max_sessions, kMaxSessions));
  status.Update(check_number("max-frames-in-flight", config.max_frames_in_flight, kMaxFramesInFlight));
  status.Update(check_number("encoder-threads", config.encoder_threads, kEncoderThreads));
  status.Update(check_duration("idle-timeout", config.idle_timeout, kIdleTimeout));
  status.Update(check_duration("drain-timeout", config.drain_timeout, kDrainTimeout));
  status.Update(check_duration("pre-drain", config.pre_drain, kPreDrain));
  status.Update(check_duration("resume-ttl", config.resume_ttl, kResumeTtl));
  status.Update(check_tls(config));
  if (!config.metrics.empty()) status.Update(check_metrics_address(config.metrics, config.insecure));
  for (const std::string& address : config.listen) {
    status.Update(check_listen_address(address, config.insecure || !config.tls_cert.empty()));
  }
  return status;
}

}  // namespace candela
