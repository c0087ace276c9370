// Words for people: near names, rounded numbers, sizes and durations, variables of the environment.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace candela {

// The word in lower case and without spaces, dots, hyphens and underscores: "Rec.709" is "rec709".
std::string folded(absl::string_view word);

// The words near `typed`, in their order; none if no word is near. Near are those with the fewest wrong,
// missing, superfluous or swapped letters, if these are at most a third of `typed`, and those that begin with
// `typed`, if these are at most four. Compares folded words.
std::vector<std::string> near_words(absl::string_view typed, const std::vector<std::string>& words);

// "did you mean aces-1, aces-hill or aces-narkowicz?" for these near words; "" for none.
std::string did_you_mean(std::vector<std::string> near);

// Words for numbers that are upper bounds.

// Three significant digits of `bound`, which is finite and not negative, rounded up: what is within the bound
// is within the number in the text. 0.02731 is "0.0274".
std::string rounded_up(double bound);

// Parses and prints sizes and times as people write them in flags and files.

// "512MiB", "2GiB", "1048576": bytes, optionally with KiB, MiB, GiB or TiB. Case does not matter.
absl::StatusOr<uint64_t> parse_bytes(const std::string& text);
// Uses the largest suffix without a remainder: "512MiB".
std::string format_bytes(uint64_t bytes);

// "60s", "1m30s", "500ms".
absl::StatusOr<absl::Duration> parse_duration(const std::string& text);

// The environment variables that begin with CANDELA_, for both programs: each warns of those that neither
// reads.

// The variables of `candela`. Those of candelad are in server/config.h.
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
