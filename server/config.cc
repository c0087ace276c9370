#include "server/config.h"

#include <algorithm>
#include <optional>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "server/base/address.h"
#include "server/base/words.h"
#include "server/vulkan/device.h"

namespace candela {

absl::Status check_listen_address(const std::string& address, bool public_too) {
  if (is_unix_address(address)) return absl::OkStatus();
  const std::optional<HostPort> at = parse_host_port(address);
  if (!at) {
    return absl::InvalidArgumentError(
        absl::StrFormat("listen address '%s' is neither HOST:PORT (port 0 .. 65535) nor unix:PATH", address));
  }
  if (public_too || is_loopback(at->host)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "'%s' is reachable from other machines, but TLS is off; set --tls-cert and --tls-key, listen on "
      "127.0.0.1 behind a proxy, or allow anyone there to connect and read everything, including tokens, "
      "with --insecure",
      address));
}

absl::Status check_metrics_address(const std::string& address, bool insecure) {
  const std::optional<HostPort> at = parse_host_port(address);
  if (!at) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "metrics is '%s'; it must be HOST:PORT (port 0 .. 65535), because metrics are served over HTTP",
        address));
  }
  if (insecure || is_loopback(at->host)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("metrics is '%s', which is reachable from other machines, and metrics have no TLS; "
                      "serve them on 127.0.0.1, or allow anyone there to read them with --insecure",
                      address));
}

namespace {

constexpr v1::Range<uint64_t> kMemoryBudgetBytes{uint64_t{1} << 20, uint64_t{1} << 40};
constexpr v1::Range<uint64_t> kFrameBytes{4, uint64_t{1} << 32};
constexpr bool kZeroIsAutomatic = true;

const Option kOptions[] = {
    {"listen", AddressListOption{&Config::listen},
     "Addresses to listen on: HOST:PORT (port 0 picks a free port) or unix:PATH",
     "Separate several addresses with commas."},
    {"insecure", FlagOption{&Config::insecure}, "Allow non-loopback addresses without TLS",
     "Anyone who can reach such an address can connect and can read everything, including tokens."},
    {"tls-cert", TextOption{&Config::tls_cert, "FILE"},
     "PEM file with the server's TLS certificate, followed by its intermediate certificates; empty: no TLS",
     "With a certificate, every address except unix:PATH uses TLS 1.2 or later. candelad rereads this file, "
     "the key and the CAs within seconds when they change, without a restart. If it cannot use the new "
     "files, it logs an error and keeps the old ones."},
    {"tls-key", TextOption{&Config::tls_key, "FILE"},
     "PEM file with the private key of tls-cert, without a passphrase",
     "Only its owner may be able to change it, and only its owner and its group may be able to read it."},
    {"tls-client-ca", TextOption{&Config::tls_client_ca, "FILE"},
     "PEM file of CAs; clients must show a certificate that one of them signed; empty: clients need none"},
    {"token-file", TextOption{&Config::token_file, "FILE"},
     "File of bearer tokens, one per line; every call must send one of them; empty: calls need no token",
     "A token has at least 16 characters (openssl rand -hex 32). A call sends it as \"authorization: Bearer "
     "TOKEN\"; health checks need none. File permissions are as for tls-key. candelad rereads the file when "
     "it changes. To replace a token, add the new one, give it to the clients, then remove the old one."},
    {"device", TextOption{&Config::device, "NAME|INDEX|host"},
     "Vulkan device: its index or a part of its name; empty: the best one; host: none",
     "See candelad --list-devices. The best device is a discrete GPU, else an integrated GPU, else a virtual "
     "GPU, else the CPU. Without one, nothing of Vulkan need be installed, this machine's processors run the "
     "passes, and there are no environments."},
    {"executor", ExecutorOption{&Config::executor}, "What runs a frame's passes: auto, device or host",
     "host: this machine's processors, in the device's memory; it takes a device of the type CPU, and AVX2, "
     "AVX-512 or NEON. auto: the host where it can, else the device."},
    {"validation", FlagOption{&Config::validation}, "Enable Vulkan's validation layers (slow)",
     "They need the package vulkan-validationlayers."},
    {"memory-budget", BytesOption{&Config::memory_budget_bytes, kMemoryBudgetBytes, kZeroIsAutomatic},
     "Memory for textures; 0: 2GiB, or 3/8 of the cgroup's memory limit if that is less",
     "It holds frames in flight and textures that are kept for later frames."},
    {"environment-budget",
     BytesOption{&Config::environment_budget_bytes, kMemoryBudgetBytes, kZeroIsAutomatic},
     "Part of the memory budget that environments may hold; 0: a quarter",
     "An environment holds its panorama and what its views read. When the budget is full, the environment "
     "that was used longest ago and that nobody uses is freed. So is one whose memory a frame needs."},
    {"client-share", NumberOption{&Config::client_share, {1, 100}},
     "How much of the memory that other clients leave one "
     "client may hold while they are connected, in percent",
     "A client is an address without its port, together with its token and its certificate if the server "
     "asks for them. Behind a proxy on a unix: socket the address is the last one of x-forwarded-for. A "
     "client that is alone may use everything, and one that holds nothing may take any frame that fits."},
    {"max-frame-bytes", BytesOption{&Config::max_frame_bytes, kFrameBytes},
     "Maximum size of a frame on the wire", "The device's largest allocation is a limit too."},
    {"max-dimension", NumberOption{&Config::max_dimension, {1, v1::kMaxDimension}},
     "Maximum width and height of a frame, in pixels"},
    {"max-calls", NumberOption{&Config::max_calls, {1, 4096}},
     "Maximum number of concurrent calls of Render, Meter, PutEnvironment and BakeEnvironment",
     "Further calls get UNAVAILABLE. The limit is lower if "
     "the cgroup's memory is too small for that many calls."},
    {"max-sessions", NumberOption{&Config::max_sessions, {1, 4096}}, "Maximum number of concurrent sessions",
     "Further sessions get UNAVAILABLE. The limit is lower if "
     "the cgroup's memory is too small for that many sessions."},
    {"max-frames-in-flight", NumberOption{&Config::max_frames_in_flight, {1, 16}},
     "Maximum number of a session's frames that have no result yet",
     "The server stops reading from a session that has this many."},
    {"max-connections", NumberOption{&Config::max_connections, {0, 65536}},
     "Maximum number of open connections; 0: 4096, or fewer if the limit of open files is low",
     "Further connections are closed at once. The limit is lower if the process may not "
     "open that many files. A connection without a call is ended after five idle timeouts."},
    {"encoder-threads", NumberOption{&Config::encoder_threads, {0, 256}},
     "Threads that encode PNG and JPEG results; 0: one per usable CPU"},
    {"idle-timeout", DurationOption{&Config::idle_timeout, {absl::Milliseconds(10), absl::Hours(24)}},
     "Disconnect a client that neither sends nor reads for this long", "This frees the client's memory."},
    {"drain-timeout", DurationOption{&Config::drain_timeout, {absl::ZeroDuration(), absl::Hours(1)}},
     "Time for frames in flight to finish after SIGTERM and pre-drain"},
    {"pre-drain", DurationOption{&Config::pre_drain, {absl::ZeroDuration(), absl::Minutes(10)}},
     "Time after SIGTERM during which new calls are accepted although health says NOT_SERVING",
     "It lets a proxy choose another server before this one refuses calls."},
    {"resume-keys", TextOption{&Config::resume_keys, "FILE"},
     "File of hex keys that sign resume tokens, one per line; empty: a random key",
     "A key has at least 32 bytes (openssl rand -hex 32). File permissions are as for tls-key. The first key "
     "signs tokens; every key verifies them. Servers that share this file can resume each other's sessions. "
     "A random key is made at each start."},
    {"resume-ttl", DurationOption{&Config::resume_ttl, {absl::Seconds(1), absl::Hours(24)}},
     "Lifetime of a resume token"},
    {"metrics", TextOption{&Config::metrics, "ADDRESS"},
     "Address that serves Prometheus metrics: HOST:PORT; empty: no metrics",
     "Metrics are at /metrics. Port 0 picks a free port. Metrics have no TLS, so a non-loopback address "
     "needs insecure."},
    {"log-level", LogLevelOption{&Config::log_level}, "Minimum log level: debug, info, warning, error or off",
     "The log goes to stderr."},
    {"log-json", FlagOption{&Config::log_json}, "Log one JSON object per line"},
};

// The notation of each kind of value.
std::string text_of(bool value) { return value ? "true" : "false"; }
std::string text_of(const std::string& value) { return value; }
std::string text_of(const std::vector<std::string>& value) { return absl::StrJoin(value, ","); }
std::string text_of(uint32_t value) { return absl::StrCat(value); }
std::string text_of(uint64_t value) { return format_bytes(value); }
std::string text_of(absl::Duration value) { return absl::FormatDuration(value); }
std::string text_of(ExecutorKind value) { return executor_word(value); }
std::string text_of(LogLevel value) { return log_level_word(value); }

template <typename Kind>
constexpr bool kHasRange = requires(Kind kind) {
  kind.range;
};

template <typename Kind>
std::string range_of(const Kind& kind) {
  if constexpr (kHasRange<Kind>) {
    std::string zero;
    if constexpr (std::is_same_v<Kind, BytesOption>) zero = kind.zero_is_automatic ? "0, or " : "";
    return absl::StrCat(zero, text_of(kind.range.min), " .. ", text_of(kind.range.max));
  }
  return "";
}

template <typename Kind>
bool is_in_range(const Kind& kind, const Config& config) {
  if constexpr (kHasRange<Kind>) {
    const auto value = config.*kind.field;
    if constexpr (std::is_same_v<Kind, BytesOption>) {
      if (kind.zero_is_automatic && value == 0) return true;
    }
    return value >= kind.range.min && value <= kind.range.max;
  }
  return true;
}

// TOML: numbers and booleans are bare, everything else is quoted.
bool is_quoted(const Option& option) {
  return !std::holds_alternative<NumberOption>(option.kind) &&
         !std::holds_alternative<FlagOption>(option.kind);
}

// `text` as comment lines of at most `kColumns`.
std::string comment(const std::string& text) {
  constexpr size_t kColumns = 120;
  std::string lines;
  std::string line = "#";
  for (const absl::string_view word : absl::StrSplit(text, ' ')) {
    if (line.size() + 1 + word.size() > kColumns) {
      absl::StrAppend(&lines, line, "\n");
      line = "#";
    }
    absl::StrAppend(&line, " ", word);
  }
  return absl::StrCat(lines, line, "\n");
}

}  // namespace

std::span<const Option> option_table() { return kOptions; }

std::string variable_name(const Option& option) {
  return "CANDELA_" + absl::AsciiStrToUpper(absl::StrReplaceAll(option.name, {{"-", "_"}}));
}

std::vector<std::string> variable_names() {
  std::vector<std::string> names;
  for (const Option& option : kOptions) names.push_back(variable_name(option));
  return names;
}

std::string range_text(const Option& option) {
  return std::visit([](const auto& kind) { return range_of(kind); }, option.kind);
}

std::string value_text(const Option& option, const Config& config) {
  return std::visit([&config](const auto& kind) { return text_of(config.*kind.field); }, option.kind);
}

absl::Status check_ranges(const Config& config) {
  for (const Option& option : kOptions) {
    if (std::visit([&config](const auto& kind) { return is_in_range(kind, config); }, option.kind)) continue;
    return absl::InvalidArgumentError(absl::StrFormat("%s is %s; it must be %s", option.name,
                                                      value_text(option, config), range_text(option)));
  }
  return absl::OkStatus();
}

std::string annotated_file(const Config& config) {
  std::string text =
      "# candelad's options with their defaults. Start it with: candelad --config candelad.conf\n"
      "# A flag (--memory-budget 4GiB) or a variable (CANDELA_MEMORY_BUDGET=4GiB) overrides the value in "
      "this file.\n"
      "# This file is generated: candelad --print-config\n";
  for (const Option& option : kOptions) {
    const std::string range = range_text(option);
    const std::string help =
        absl::StrCat(option.help, range.empty() ? "" : absl::StrCat(" (", range, ")"), ".");
    const std::string value = value_text(option, config);
    absl::StrAppend(&text, "\n", comment(*option.note == '\0' ? help : absl::StrCat(help, " ", option.note)),
                    option.name, " = ", is_quoted(option) ? absl::StrCat("\"", value, "\"") : value, "\n");
  }
  return text;
}

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
