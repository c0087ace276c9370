#include "client/cli/options/server_options.h"

#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/usage.h"

namespace candela {
namespace {

constexpr char kServer[] = "Server";

// Parses "ADDRESS,ADDRESS,..." into the first address and the others.
absl::Status set_servers(const std::string& text, ServerChoice& choice) {
  const std::vector<std::string> addresses = absl::StrSplit(text, ',');
  for (const std::string& address : addresses) {
    if (address.empty()) {
      return usage_error(
          absl::StrFormat("--server is \"%s\"; it must be addresses separated by commas", text));
    }
  }
  choice.address = addresses.front();
  choice.others.assign(addresses.begin() + 1, addresses.end());
  return absl::OkStatus();
}

void add_security_and_device(CLI::App& app, ServerChoice& choice) {
  add_security_options(app, kServer, choice.security);
  add_text(app, kServer, "--device", "NAME|INDEX",
           "Vulkan device for the built-in server: part of its name, or its index (default: the best one)",
           choice.device);
}

}  // namespace

void add_server_options(CLI::App& app, ServerChoice& choice) {
  add_text(app, kServer, "--server", "ADDRESS",
           "A running candelad, HOST:PORT or unix:PATH (default: a server built into this process)",
           choice.address);
  add_security_and_device(app, choice);
}

void add_servers_options(CLI::App& app, ServerChoice& choice) {
  add_text(
      app, kServer, "--server", "ADDRESS[,...]",
      "Running candelads, HOST:PORT or unix:PATH: the first that answers, and the next one if it is lost "
      "(default: a server built into this process)",
      [&choice](const std::string& text) { return set_servers(text, choice); });
  add_security_and_device(app, choice);
}

void add_security_options(CLI::App& app, const std::string& section, ClientSecurity& security) {
  const auto add = [&app, &section](const char* name, const char* variable, const char* placeholder,
                                    std::string& value, const std::string& help) {
    add_text(app, section, name, placeholder, help + ", or $" + variable, value)->envname(variable);
  };
  app.add_flag("--tls", security.tls,
               "Use TLS and trust this system's CAs, or $CANDELA_CLIENT_TLS; unix:PATH needs no TLS")
      ->group(section)
      ->envname("CANDELA_CLIENT_TLS");
  add("--tls-ca", "CANDELA_CLIENT_TLS_CA", "FILE", security.ca_file,
      "Use TLS and trust the CAs in this PEM file");
  add("--tls-name", "CANDELA_CLIENT_TLS_NAME", "NAME", security.server_name,
      "Use TLS and expect this name in the server's certificate instead of the address");
  add("--tls-cert", "CANDELA_CLIENT_TLS_CERT", "FILE", security.cert_file,
      "Use TLS and show this client certificate, PEM");
  add("--tls-key", "CANDELA_CLIENT_TLS_KEY", "FILE", security.key_file, "Private key of --tls-cert, PEM");
  add("--token-file", "CANDELA_CLIENT_TOKEN_FILE", "FILE", security.token_file,
      "File with the bearer token to send, on its first line; never sent unencrypted to another machine");
}

absl::Status check_server_options(const ServerChoice& choice) {
  if (choice.address.empty() || choice.device.empty()) return absl::OkStatus();
  return usage_error(
      "--device chooses the built-in server's device and has no effect with --server; give one of them");
}

}  // namespace candela
