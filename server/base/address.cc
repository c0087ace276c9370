#include "server/base/address.h"

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"

namespace candela {
namespace {

constexpr absl::string_view kUnix = "unix:";
constexpr uint32_t kMaxPort = 65535;
constexpr absl::string_view kDefaultPort = ":50051";  // of kDefaultAddress

}  // namespace

bool is_unix_address(absl::string_view address) {
  return absl::StartsWith(address, kUnix) && address.size() > kUnix.size();
}

std::optional<HostPort> parse_host_port(absl::string_view address) {
  const size_t colon = address.rfind(':');
  if (colon == absl::string_view::npos) return std::nullopt;
  HostPort parsed{address.substr(0, colon)};
  if (!absl::SimpleAtoi(address.substr(colon + 1), &parsed.port) || parsed.port > kMaxPort)
    return std::nullopt;
  const bool bracketed = absl::ConsumePrefix(&parsed.host, "[") && absl::ConsumeSuffix(&parsed.host, "]");
  if (parsed.host.empty()) return std::nullopt;
  if (!bracketed && parsed.host.find_first_of("[]:/") != absl::string_view::npos) return std::nullopt;
  return parsed;
}

std::string with_default_port(absl::string_view address) {
  const bool bracketed = absl::StartsWith(address, "[") && absl::EndsWith(address, "]");
  const bool bare = address.find_first_of("[]:/") == absl::string_view::npos &&
                    address.find_first_not_of("0123456789") != absl::string_view::npos;  // a port
  const std::string whole = absl::StrCat(address, kDefaultPort);
  return (bracketed || bare) && parse_host_port(whole) ? whole : std::string(address);
}

bool is_loopback(absl::string_view host) {
  const bool all_digits = host.find_first_not_of("0123456789.") == absl::string_view::npos;
  return host == "localhost" || host == "::1" || (all_digits && absl::StartsWith(host, "127."));
}

}  // namespace candela
