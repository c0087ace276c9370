#include "client/cli/options/server_options.h"

#include <cstdlib>
#include <functional>
#include <map>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/base/failure.h"
#include "client/cli/options/option_kinds.h"
#include "server/base/address.h"
#include "server/base/status_macros.h"
#include "server/base/words.h"

namespace candela {
namespace {

constexpr char kServerOption[] = "--server";

// Parses "ADDRESS,ADDRESS,..." of `source` into the first address and the others.
absl::Status set_servers(const std::string& source, const std::string& text, ServerChoice& choice) {
  const std::vector<std::string> addresses = absl::StrSplit(text, ',');
  for (const std::string& address : addresses) {
    if (address.empty()) {
      return usage_error(
          absl::StrFormat("%s is \"%s\"; it must be addresses separated by commas", source, text));
    }
  }
  choice.address = with_default_port(addresses.front());
  choice.others.clear();
  for (size_t i = 1; i < addresses.size(); ++i) choice.others.push_back(with_default_port(addresses[i]));
  choice.source = source;
  return absl::OkStatus();
}

std::function<absl::Status(const std::string&)> set_server(ServerChoice& choice) {
  return [&choice](const std::string& address) {
    choice.address = with_default_port(address);
    choice.source = kServerOption;
    return absl::OkStatus();
  };
}

void add_security_and_device(CLI::App& app, ServerChoice& choice) {
  add_security_options(app, kServerSection, choice.security);
  add_text(app, kServerSection, "--device", "NAME|INDEX|host",
           absl::StrCat(
               "Render in this process, even if $CANDELA_SERVER is set, on this Vulkan device: part of its "
               "name, or its index; host: without one (default: ",
               choice.bakes ? "the best one)" : "a GPU, else host)"),
           choice.device);
  add_text(
      app, kServerSection, "--executor", "WHO",
      "Render in this process, with the passes run by: device, host (this machine's processors) or auto "
      "(default: auto, which is host without a GPU if the processors can, else device)",
      [&choice](const std::string& text) {
        if (text != "auto" && text != "device" && text != "host") {
          return usage_error(absl::StrFormat("--executor is \"%s\"; it must be auto, device or host", text));
        }
        choice.executor = text;
        return absl::OkStatus();
      });
}

// Takes CANDELA_SERVER unless the line chooses another server.
absl::Status take_variable(ServerChoice& choice) {
  const char* variable = std::getenv(kServerVariable);
  if (!choice.source.empty() || !choice.device.empty() || !choice.executor.empty() || variable == nullptr ||
      *variable == '\0') {
    return absl::OkStatus();
  }
  absl::Status status = set_servers(kServerVariable, variable, choice);
  choice.source = absl::StrCat("from ", kServerVariable);
  if (!choice.takes_several) choice.others.clear();
  return status;
}

}  // namespace

void add_server_options(CLI::App& app, ServerChoice& choice) {
  add_text(
      app, kServerSection, kServerOption, "ADDRESS",
      "A running candelad, HOST[:PORT] or unix:PATH (default: $CANDELA_SERVER, or else a server built into "
      "this process)",
      set_server(choice));
  add_security_and_device(app, choice);
}

void add_servers_options(CLI::App& app, ServerChoice& choice) {
  add_text(
      app, kServerSection, kServerOption, "ADDRESS[,...]",
      "Running candelads, HOST[:PORT] or unix:PATH: the first that answers, and the next one if it is lost "
      "(default: $CANDELA_SERVER, or else a server built into this process)",
      [&choice](const std::string& text) { return set_servers(kServerOption, text, choice); });
  choice.takes_several = true;
  add_number(app, kServerSection, "--resume", "SECONDS", {0, kSeconds.max},
             absl::ToDoubleSeconds(choice.resume_limit),
             "How long to look for a server when one is lost, and to wait for one that is full or starting",
             [&choice](double seconds) { choice.resume_limit = absl::Seconds(seconds); });
  add_security_and_device(app, choice);
}

void add_transport_option(CLI::App& app, ServerChoice& choice) {
  add_text(app, kServerSection, "--transport", "WAY",
           "How frames and images travel: grpc, zstd (grpc with compressed frames), memory (shared with a "
           "server at unix:PATH) "
           "or auto (default: auto, which is memory where the server offers it, else grpc, and zstd on a "
           "slow link)",
           [&choice](const std::string& text) {
             static const std::map<std::string, Transport> kWays = {{"auto", Transport::kAuto},
                                                                    {"grpc", Transport::kGrpc},
                                                                    {"zstd", Transport::kZstd},
                                                                    {"memory", Transport::kMemory}};
             const auto way = kWays.find(text);
             if (way == kWays.end()) {
               return usage_error(
                   absl::StrFormat("--transport is \"%s\"; it must be auto, grpc, zstd or memory", text));
             }
             choice.transport = way->second;
             return absl::OkStatus();
           });
}

void add_running_server_option(CLI::App& app, const std::string& section, ServerChoice& choice) {
  add_text(
      app, section, kServerOption, "ADDRESS",
      absl::StrFormat("The candelad to ask, HOST[:PORT] or unix:PATH (default: $CANDELA_SERVER, or else %s)",
                      kDefaultAddress),
      set_server(choice));
}

void add_security_options(CLI::App& app, const std::string& section, ClientSecurity& security) {
  const auto add = [&app, &section](const char* name, const char* variable, const char* placeholder,
                                    std::string& value, const std::string& help) {
    add_text(app, section, name, placeholder, help + " (default: $" + variable + ")", value)
        ->envname(variable);
  };
  app.add_flag(
         "--tls", security.tls,
         "Use TLS and trust this system's CAs; $CANDELA_CLIENT_TLS=true does the same; unix:PATH has no TLS")
      ->option_text(" ")
      ->group(section)
      ->envname(kTlsVariable);
  add("--tls-ca", kTlsCaVariable, "FILE", security.ca_file, "Use TLS and trust the CAs in this PEM file");
  add("--tls-name", kTlsNameVariable, "NAME", security.server_name,
      "Use TLS and expect this name in the server's certificate instead of the address");
  add("--tls-cert", kTlsCertVariable, "FILE", security.cert_file,
      "Use TLS and show this client certificate, PEM");
  add("--tls-key", kTlsKeyVariable, "FILE", security.key_file, "Private key of --tls-cert, PEM");
  add("--token-file", kTokenFileVariable, "FILE", security.token_file,
      "File with the bearer token to send: its first line that is no comment; never sent unencrypted to "
      "another machine");
}

absl::Status finish_server_options(ServerChoice& choice) {
  if (!choice.address.empty() && !choice.device.empty()) {
    return usage_error(
        "--device chooses the built-in server's device and has no effect with --server; give one of them");
  }
  if (!choice.address.empty() && !choice.executor.empty()) {
    return usage_error(
        "--executor is an option of the built-in server and has no effect with --server; give one of them");
  }
  if (absl::EqualsIgnoreCase(choice.device, "host") && choice.executor == "device") {
    return usage_error("--device host is no Vulkan device, which --executor device needs; give one of them");
  }
  RETURN_IF_ERROR(take_variable(choice));
  if (choice.transport != Transport::kMemory || is_unix_address(choice.address)) return absl::OkStatus();
  return usage_error(
      "--transport is memory, which only a server at unix:PATH can share; name one with --server, or use "
      "auto, grpc or zstd");
}

absl::Status name_source(const absl::Status& status, const ServerChoice& choice) {
  if (status.ok() || choice.source.empty() || choice.source == kServerOption) return status;
  bool named = absl::StrContains(status.message(), choice.address);
  for (const std::string& other : choice.others) named |= absl::StrContains(status.message(), other);
  if (!named) return status;
  return reworded(status, absl::StrFormat("%s (the address is %s)", status.message(), choice.source));
}

}  // namespace candela
