// Addresses that servers listen on and that clients connect to.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "absl/strings/string_view.h"

namespace candela {

// candelad listens here by default, and `candela health` asks there.
inline constexpr char kDefaultAddress[] = "127.0.0.1:50051";

// Whether the address has the form "unix:PATH".
bool is_unix_address(absl::string_view address);

struct HostPort {
  absl::string_view host;  // points into the text; an IPv6 address without its brackets
  uint32_t port = 0;       // 0 .. 65535
};

// Parses "HOST:PORT", with an IPv6 host in brackets. Returns nothing for any other form.
std::optional<HostPort> parse_host_port(absl::string_view address);

// "HOST:50051" for "HOST", a name or an IPv4 address, and "[IPV6]:50051" for "[IPV6]": the port that candelad
// listens on by default. Other texts, and a number by itself, stay as they are.
std::string with_default_port(absl::string_view address);

// True for localhost, ::1 and 127.0.0.0/8. Other names are never resolved, even if they lead to this machine.
bool is_loopback(absl::string_view host);

}  // namespace candela
