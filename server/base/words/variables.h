// The environment variables that begin with CANDELA_, for both programs: each warns of those that neither
// reads.
#pragma once

#include <string>
#include <vector>

namespace candela {

// The variables of `candela`. Those of candelad are in server/option_table.h.
inline constexpr char kServerVariable[] = "CANDELA_SERVER";
inline constexpr char kTlsVariable[] = "CANDELA_CLIENT_TLS";
inline constexpr char kTlsCaVariable[] = "CANDELA_CLIENT_TLS_CA";
inline constexpr char kTlsNameVariable[] = "CANDELA_CLIENT_TLS_NAME";
inline constexpr char kTlsCertVariable[] = "CANDELA_CLIENT_TLS_CERT";
inline constexpr char kTlsKeyVariable[] = "CANDELA_CLIENT_TLS_KEY";
inline constexpr char kTokenFileVariable[] = "CANDELA_CLIENT_TOKEN_FILE";

struct UnknownVariable {
  std::string name;   // "CANDELA_SEVER"
  std::string words;  // "did you mean CANDELA_SERVER?", or "" if no known name is near
};

// The variables of this process's environment that begin with CANDELA_ and that nothing reads, by name.
// `daemon_variables` are those of candelad. Variables of Candela's own scripts and tests are known, and so
// are the links that Kubernetes sets for a Service whose name begins with candela.
std::vector<UnknownVariable> unknown_variables(const std::vector<std::string>& daemon_variables);

}  // namespace candela
