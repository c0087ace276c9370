// SHA-256.
#pragma once

#include <string>
#include <string_view>

namespace candela {

// 32 bytes. Empty if OpenSSL offers no SHA-256, which is no build of Debian's.
std::string sha256(std::string_view bytes);
std::string sha256_hex(std::string_view bytes);

}  // namespace candela
