#include "client/cli/options/security_options.h"

#include "client/cli/options/option_kinds.h"

namespace candela {

void add_security_options(CLI::App& app, const std::string& section, ClientSecurity& security) {
  const auto add = [&app, &section](const char* name, const char* variable, const char* placeholder,
                                    std::string& value, const std::string& help) {
    add_text(app, section, name, placeholder, help + ", or $" + variable, [&value](const std::string& text) {
      value = text;
      return absl::OkStatus();
    })->envname(variable);
  };
  app.add_flag(
         "--tls", security.tls,
         "TLS, trusting the CAs of this system, or $CANDELA_CLIENT_TLS; not over unix:PATH, which needs none")
      ->group(section)
      ->envname("CANDELA_CLIENT_TLS");
  add("--tls-ca", "CANDELA_CLIENT_TLS_CA", "FILE", security.ca_file,
      "TLS, trusting the CAs in this PEM file");
  add("--tls-name", "CANDELA_CLIENT_TLS_NAME", "NAME", security.server_name,
      "TLS, where the server's certificate is for another name than the address");
  add("--tls-cert", "CANDELA_CLIENT_TLS_CERT", "FILE", security.cert_file,
      "TLS, showing this client certificate, PEM");
  add("--tls-key", "CANDELA_CLIENT_TLS_KEY", "FILE", security.key_file, "Private key of --tls-cert, PEM");
  add("--token-file", "CANDELA_CLIENT_TOKEN_FILE", "FILE", security.token_file,
      "File whose first line is a bearer token to show; never sent in the clear beyond this machine");
}

}  // namespace candela
