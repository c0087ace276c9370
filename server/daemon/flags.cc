// candelad's options, each defined once: flag, variable, key of the file, range, unit and default.
#include <CLI/CLI.hpp>
#include <cctype>
#include <cstdlib>
#include <map>

#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "server/base/units.h"
#include "server/config.h"

#ifndef CANDELA_VERSION
#error "the build sets CANDELA_VERSION"
#endif

namespace candela {
namespace {

const std::map<std::string, LogLevel> kLogLevels{{"debug", LogLevel::kDebug},
                                                 {"info", LogLevel::kInfo},
                                                 {"warning", LogLevel::kWarning},
                                                 {"error", LogLevel::kError},
                                                 {"off", LogLevel::kOff}};

// Every option has the variable CANDELA_<NAME>. A later flag replaces an earlier one.
CLI::Option* finish(CLI::Option* option, const std::string& name) {
  std::string variable = "CANDELA_" + absl::StrReplaceAll(name, {{"-", "_"}});
  for (char& c : variable) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return option->envname(variable)->take_last();
}

// An option that `set` reads from its text.
template <typename Set>
CLI::Option* add(CLI::App& app, const std::string& name, const std::string& type, const std::string& initial,
                 const std::string& help, Set set) {
  const auto apply = [name, set](const std::string& text) {
    const absl::Status status = set(text);
    if (!status.ok()) throw CLI::ValidationError("--" + name, std::string(status.message()));
  };
  CLI::Option* option = app.add_option_function<std::string>("--" + name, apply, help);
  return finish(option->type_name(type)->default_str(initial), name);
}

void add_flag(CLI::App& app, const std::string& name, bool& value, const std::string& help) {
  finish(app.add_flag("--" + name, value, help), name);
}

void add_text(CLI::App& app, const std::string& name, const std::string& type, std::string& value,
              const std::string& help) {
  add(app, name, type, value, help, [&value](const std::string& text) {
    value = text;
    return absl::OkStatus();
  });
}

void add_bytes(CLI::App& app, const std::string& name, uint64_t& value, v1::Range<uint64_t> range,
               const std::string& help) {
  const std::string limits = absl::StrFormat(", %s .. %s", format_bytes(range.min), format_bytes(range.max));
  add(app, name, "BYTES", format_bytes(value), help + limits, [&value](const std::string& text) {
    const absl::StatusOr<uint64_t> bytes = parse_bytes(text);
    if (bytes.ok()) value = *bytes;
    return bytes.status();
  });
}

void add_number(CLI::App& app, const std::string& name, uint32_t& value, v1::Range<uint32_t> range,
                const std::string& help) {
  const std::string limits = absl::StrFormat(", %d .. %d", range.min, range.max);
  finish(app.add_option("--" + name, value, help + limits)->capture_default_str()->type_name("NUMBER"), name);
}

void add_duration(CLI::App& app, const std::string& name, absl::Duration& value,
                  v1::Range<absl::Duration> range, const std::string& help) {
  const std::string limits =
      absl::StrFormat(", %s .. %s", absl::FormatDuration(range.min), absl::FormatDuration(range.max));
  add(app, name, "TIME", absl::FormatDuration(value), help + limits, [&value](const std::string& text) {
    const absl::StatusOr<absl::Duration> time = parse_duration(text);
    if (time.ok()) value = *time;
    return time.status();
  });
}

void add_log_options(CLI::App& app, LogOptions& log) {
  add(app, "log-level", "LEVEL", "info",
      "Least weight of the events logged: debug, info, warning, error or off",
      [&log](const std::string& text) {
        const auto level = kLogLevels.find(text);
        if (level == kLogLevels.end()) {
          return absl::InvalidArgumentError(
              absl::StrFormat("'%s' is not one of debug, info, warning, error and off", text));
        }
        log.level = level->second;
        return absl::OkStatus();
      });
  add_flag(app, "log-json", log.json, "Log one JSON object a line");
}

void add_options(CLI::App& app, Invocation& invocation) {
  Config& config = invocation.config;
  add(app, "listen", "ADDRESS[,ADDRESS...]", kDefaultListen,
      "Where to listen: HOST:PORT, port 0 for a free one, or unix:PATH", [&config](const std::string& text) {
        config.listen = absl::StrSplit(text, ',', absl::SkipWhitespace());
        if (!config.listen.empty()) return absl::OkStatus();
        return absl::InvalidArgumentError("it names no address; write 127.0.0.1:50051 or unix:PATH");
      });
  add_flag(app, "insecure", config.insecure, "Allow addresses beyond loopback without TLS");
  add_text(app, "tls-cert", "FILE", config.tls_cert,
           "Certificate to serve TLS with, PEM, the server's own first; read again when it changes; empty: "
           "no TLS");
  add_text(app, "tls-key", "FILE", config.tls_key, "Private key of tls-cert, PEM, without a passphrase");
  add_text(app, "tls-client-ca", "FILE", config.tls_client_ca,
           "CAs, PEM: clients must show a certificate that one of them has signed; empty: they need none");
  add_text(
      app, "token-file", "FILE", config.token_file,
      "Bearer tokens, one a line: a call must show one of them; read again when it changes; empty: none");
  add_text(app, "device", "NAME|INDEX", config.device,
           "Vulkan device: a part of its name or its index; empty takes the best");
  add_flag(app, "validation", config.validation, "Run with Vulkan's validation layers (slow)");
  add_text(app, "cache-dir", "PATH", config.cache_dir,
           "Where to keep what was measured about the device; empty takes the user's cache");
  add_bytes(app, "memory-budget", config.memory_budget_bytes, kMemoryBudgetBytes,
            "Memory for textures; 0: 2GiB, or 3/8 of the cgroup's memory where that is less");
  add_bytes(app, "max-frame-bytes", config.max_frame_bytes, kMaxFrameBytes, "Largest frame on the wire");
  add_number(app, "max-dimension", config.max_dimension, kMaxDimension, "Largest width or height, in pixels");
  add_number(app, "max-calls", config.max_calls, kMaxCalls, "Render and Meter calls at once");
  add_number(app, "max-sessions", config.max_sessions, kMaxSessions, "Streams at once");
  add_number(app, "max-frames-in-flight", config.max_frames_in_flight, kMaxFramesInFlight,
             "Frames of a session without a result");
  add_number(app, "encoder-threads", config.encoder_threads, kEncoderThreads,
             "Threads for PNG and JPEG results; 0: one per CPU that it may use");
  add_duration(app, "idle-timeout", config.idle_timeout, kIdleTimeout,
               "A client that neither sends nor reads for so long is cut off");
  add_duration(app, "drain-timeout", config.drain_timeout, kDrainTimeout,
               "How long frames in flight may take after SIGTERM");
  add_duration(app, "pre-drain", config.pre_drain, kPreDrain,
               "How long after SIGTERM calls are still taken while health says NOT_SERVING");
  add_text(app, "resume-keys", "FILE", config.resume_keys,
           "Keys that sign resume tokens, one a line in hex; empty takes a key of this server's own");
  add_duration(app, "resume-ttl", config.resume_ttl, kResumeTtl, "How long a resume token is good");
  add_text(app, "metrics", "ADDRESS", config.metrics,
           "Where to serve Prometheus metrics: HOST:PORT, IPv4; empty: nowhere");
  add_log_options(app, invocation.log);
}

// CLI11 by itself would let the file win over the environment.
void apply_environment(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    const char* value = option->get_envname().empty() ? nullptr : std::getenv(option->get_envname().c_str());
    if (value != nullptr && *value != '\0') option->add_result(value);
  }
}

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

}  // namespace

absl::StatusOr<Invocation> parse_invocation(int argc, const char* const* argv) {
  Invocation invocation;
  invocation.config.listen = {kDefaultListen};
  CLI::App app("candelad: renders HDR frames that come over gRPC.\n", "candelad");
  app.footer(
      "Every option may also be an environment variable, CANDELA_MEMORY_BUDGET for --memory-budget, or a "
      "key\n"
      "of the --config file without its dashes. Flags win over variables, and variables over the file.");
  app.allow_config_extras(CLI::config_extras_mode::error);
  add_options(app, invocation);
  app.set_config("--config", "", "File of options, key = value; see candelad.conf")->type_name("FILE");
  app.add_flag("--list-devices", invocation.list_devices, "List the Vulkan devices and exit")
      ->configurable(false);
  app.set_version_flag("--version", "candelad " CANDELA_VERSION, "Print the version and exit");
  app.preparse_callback([&app](size_t) { apply_environment(app); });
  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp&) {
    invocation.text = app.help();
    return invocation;
  } catch (const CLI::CallForVersion& version) {
    invocation.text = absl::StrFormat("%s\n", version.what());
    return invocation;
  } catch (const CLI::FileError&) {
    return absl::InvalidArgumentError(
        absl::StrFormat("--config: cannot read %s; name a file such as deploy/candelad.conf",
                        app.get_config_ptr()->as<std::string>()));
  } catch (const CLI::Error& error) {
    return absl::InvalidArgumentError(first_line(error.what()) + "; see candelad --help");
  }
  if (absl::Status status = check_config(invocation.config); !status.ok()) return status;
  return invocation;
}

}  // namespace candela
