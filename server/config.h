// What a server is told: by flags, by the environment, by a file, or by the program that embeds it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "proto/candela/v1/limits.h"
#include "server/base/log.h"

namespace candela {

inline constexpr char kDefaultListen[] = "127.0.0.1:50051";

// The defaults are candelad's, except that a server listens nowhere until it is told to.
struct Config {
  std::vector<std::string>
      listen;             // "HOST:PORT" (port 0 takes a free one) or "unix:PATH"; empty: in-process only
  bool insecure = false;  // allow addresses beyond loopback without TLS, where any one can connect and read
  std::string tls_cert;   // PEM files; empty: no TLS. Read again when they change
  std::string tls_key;    // of tls_cert
  std::string tls_client_ca;         // clients must show a certificate of one of these; empty: they need none
  std::string token_file;            // bearer tokens, of which a call must show one; empty: none is asked for
  std::string device;                // a part of a device's name, or its index; empty: the best there is
  bool validation = false;           // Vulkan's validation layers
  std::string cache_dir;             // for what was measured about the device; empty: kept in memory only
  uint64_t memory_budget_bytes = 0;  // for the texture pool; 0: see choose_memory_budget
  uint64_t max_frame_bytes = v1::kDefaultMaxFrameBytes;  // of one frame on the wire
  uint32_t max_dimension = v1::kMaxDimension;            // width or height, pixels
  uint32_t max_calls = 64;                               // Render and Meter calls at once
  uint32_t max_sessions = 64;                            // streams at once
  uint32_t max_frames_in_flight = 2;                     // of a session, without a result
  uint32_t encoder_threads = 0;                          // for PNG and JPEG results; 0: usable_cpus()
  absl::Duration idle_timeout =
      absl::Seconds(60);  // a client that neither sends nor reads for so long is cut off
  absl::Duration drain_timeout =
      absl::Seconds(30);  // how long frames in flight may take once the server stops
  // Between health's NOT_SERVING and the first refusal: time for proxies to look elsewhere.
  absl::Duration pre_drain = absl::ZeroDuration();
  std::string resume_keys;  // file of keys that sign resume tokens; empty: a key of this server's own
  absl::Duration resume_ttl = absl::Minutes(10);         // how long a resume token is good
  absl::Duration heartbeat_interval = absl::Seconds(5);  // without a good frame: then one is rendered to see
  absl::Duration heartbeat_limit = absl::Seconds(30);    // for so long health is good without one
  std::string metrics;  // "HOST:PORT" where /metrics is served; empty: nowhere
};

// Inclusive.
inline constexpr v1::Range<uint64_t> kMemoryBudgetBytes{uint64_t{1} << 20, uint64_t{1} << 40};
inline constexpr v1::Range<uint64_t> kMaxFrameBytes{4, uint64_t{1} << 32};
inline constexpr v1::Range<uint32_t> kMaxDimension{1, v1::kMaxDimension};
inline constexpr v1::Range<uint32_t> kMaxCalls{1, 4096};
inline constexpr v1::Range<uint32_t> kMaxSessions{1, 4096};
inline constexpr v1::Range<uint32_t> kMaxFramesInFlight{1, 16};
inline constexpr v1::Range<uint32_t> kEncoderThreads{0, 256};
inline constexpr v1::Range<absl::Duration> kIdleTimeout{absl::Milliseconds(10), absl::Hours(24)};
inline constexpr v1::Range<absl::Duration> kDrainTimeout{absl::ZeroDuration(), absl::Hours(1)};
inline constexpr v1::Range<absl::Duration> kPreDrain{absl::ZeroDuration(), absl::Minutes(10)};
inline constexpr v1::Range<absl::Duration> kResumeTtl{absl::Seconds(1), absl::Hours(24)};

// $XDG_CACHE_HOME/candela or ~/.cache/candela; empty where there is neither.
std::string default_cache_dir();

// INVALID_ARGUMENT naming the option, its value and its range.
absl::Status check_config(const Config& config);

// What candelad was asked to do.
struct Invocation {
  Config config;
  LogOptions log;
  bool list_devices = false;
  std::string text;  // not empty: print this and do nothing else (--help, --version)
};

// Reads flags, then CANDELA_* variables, then the file that --config names; the first of them that has an
// option wins. INVALID_ARGUMENT, in one line, for anything that is not understood or out of its range.
absl::StatusOr<Invocation> parse_invocation(int argc, const char* const* argv);

}  // namespace candela
