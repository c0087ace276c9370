// Addresses, as a server listens on them and clients name them.
#pragma once

#include <cstdint>
#include <optional>

#include "absl/strings/string_view.h"

namespace candela::v1 {

// "unix:PATH".
bool is_unix_address(absl::string_view address);

struct HostPort {
  absl::string_view host;  // a part of the text; of an IPv6 address without its brackets
  uint32_t port = 0;       // 0 .. 65535
};

// Of "HOST:PORT", with an IPv6 host in brackets; nothing for any other shape.
std::optional<HostPort> parse_host_port(absl::string_view address);

// Whether what is sent there stays on this machine: localhost, ::1 and 127.0.0.0/8, whatever else a name may
// resolve to.
bool is_loopback(absl::string_view host);

}  // namespace candela::v1
