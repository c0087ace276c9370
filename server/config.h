// What candelad is told: the configuration, the table of its options, and the addresses that it listens on.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "proto/candela/v1/limits.h"
#include "server/base/log.h"
#include "server/base/slices.h"
#include "server/render/executor_kind.h"

namespace candela {

// OK if `address` is "HOST:PORT" (an IPv6 host is in brackets) or "unix:PATH"; INVALID_ARGUMENT for any other
// shape. Also INVALID_ARGUMENT for a non-loopback host unless `public_too`: without TLS anyone could connect
// and read everything, including tokens.
absl::Status check_listen_address(const std::string& address, bool public_too);

// The same for the metrics address. Metrics are served over plain HTTP, and not on "unix:PATH".
absl::Status check_metrics_address(const std::string& address, bool insecure);

// The configuration of a server. candelad fills it from its options; a program that embeds a server fills it
// itself.

// server/config.cc has the range, the help text and the option name of each field. The defaults here
// are candelad's too, except `listen`: an embedded server listens nowhere by default.
struct Config {
  // "HOST:PORT" (port 0 picks a free port) or "unix:PATH"; empty: in-process only
  std::vector<std::string> listen;
  bool insecure = false;      // allow non-loopback addresses without TLS
  std::string tls_cert;       // PEM file, reread when it changes; empty: no TLS
  std::string tls_key;        // PEM file with the key of tls_cert
  std::string tls_client_ca;  // PEM file of CAs that sign client certificates; empty: none are required
  std::string token_file;     // bearer tokens; empty: calls need no token
  std::string device;         // DeviceOptions::selector
  ExecutorKind executor = ExecutorKind::kAuto;  // who makes a frame's passes
  bool validation = false;                      // enable Vulkan's validation layers
  uint64_t memory_budget_bytes = 0;             // for the texture pool; 0: see choose_memory_budget
  uint64_t environment_budget_bytes = 0;        // for environments; 0: a quarter of memory_budget_bytes
  uint32_t client_share = 50;  // percent of the memory that other clients leave; see ClientBudget
  uint64_t max_frame_bytes = v1::kDefaultMaxFrameBytes;  // one frame on the wire
  uint32_t max_dimension = v1::kMaxDimension;            // width or height, pixels
  uint32_t max_calls = 64;                               // concurrent Render and Meter calls
  uint32_t max_connections = 0;                          // 0: see choose_descriptors
  uint32_t max_sessions = 64;                            // concurrent sessions
  uint32_t max_frames_in_flight = 2;                     // frames of one session that have no result yet
  uint32_t encoder_threads = 0;                          // for PNG and JPEG results; 0: usable_cpus()
  absl::Duration idle_timeout = absl::Seconds(60);   // a client that neither sends nor reads is disconnected
  absl::Duration drain_timeout = absl::Seconds(30);  // for frames in flight when the server stops
  absl::Duration pre_drain = absl::ZeroDuration();  // between health's NOT_SERVING and the first refused call
  std::string resume_keys;                          // file of keys; empty: a random key
  absl::Duration resume_ttl = absl::Minutes(10);    // lifetime of a resume token
  std::string metrics;                              // "HOST:PORT" that serves /metrics; empty: none
  LogLevel log_level = LogLevel::kInfo;  // for candelad; an embedded server ignores both log fields
  bool log_json = false;                 // one JSON object per line

  // Has no option. If `device` is empty, the server uses a Vulkan device only if it is a GPU, or if the host
  // cannot make the passes.
  bool host_without_gpu = false;

  // These have no option. After heartbeat_interval without a good frame, the server renders a test frame.
  // After heartbeat_limit without a good frame, it is not healthy.
  absl::Duration heartbeat_interval = absl::Seconds(5);
  absl::Duration heartbeat_limit = absl::Seconds(30);
  // A device that has not answered for so long counts as hung. It is less than the time after which the
  // render thread counts as stuck, so that a hung device fails its frames before liveness fails.
  absl::Duration hang_limit = absl::Seconds(90);
  // The render thread turns to other work after this much of a long job.
  absl::Duration slice = kSlice;
};

// INVALID_ARGUMENT if an option is out of its range or contradicts another one. The message names the option,
// its value and its range.
absl::Status check_config(const Config& config);

// The table of candelad's options: one row per option. Everything about an option comes from its row: the
// flag, the environment variable, the key of the configuration file, the range check, --help and
// deploy/candelad.conf.
//
// To add an option, add a field with its default to Config and a row here, and run
//   candelad --print-config >deploy/candelad.conf

// The kinds of options. Each kind names its field of Config; ranges are inclusive.
struct FlagOption {
  bool Config::*field;
};
struct TextOption {
  std::string Config::*field;
  const char* value_name;  // "FILE"
};
struct AddressListOption {
  std::vector<std::string> Config::*field;  // written with commas
};
struct NumberOption {
  uint32_t Config::*field;
  v1::Range<uint32_t> range;
};
struct BytesOption {
  uint64_t Config::*field;
  v1::Range<uint64_t> range;
  bool zero_is_automatic = false;  // 0 is allowed below the range
};
struct DurationOption {
  absl::Duration Config::*field;
  v1::Range<absl::Duration> range;
};
struct LogLevelOption {
  LogLevel Config::*field;
};
struct ExecutorOption {
  ExecutorKind Config::*field;
};

using OptionKind = std::variant<FlagOption, TextOption, AddressListOption, NumberOption, BytesOption,
                                DurationOption, LogLevelOption, ExecutorOption>;

struct Option {
  // "max-calls": the flag is --max-calls, the variable CANDELA_MAX_CALLS, the key in the file max-calls.
  const char* name;
  OptionKind kind;
  // For --help and the annotated file: one sentence, without its full stop and without the range.
  const char* help;
  // For the annotated file only: more sentences.
  const char* note = "";
};

std::span<const Option> option_table();

// The option's environment variable, such as "CANDELA_MAX_CALLS".
std::string variable_name(const Option& option);

// The environment variables of all options.
std::vector<std::string> variable_names();

// The option's range, "1 .. 4096"; empty if its kind has none.
std::string range_text(const Option& option);

// The option's value in `config` as a user writes it: "64", "512MiB", "1m", "true".
std::string value_text(const Option& option, const Config& config);

// INVALID_ARGUMENT for the first option that is out of its range: "max-calls is 0; it must be 1 .. 4096".
absl::Status check_ranges(const Config& config);

// deploy/candelad.conf: every option, explained, with its value in `config`.
std::string annotated_file(const Config& config);

}  // namespace candela
