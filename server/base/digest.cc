#include "server/base/digest.h"

#include <openssl/evp.h>

#include "absl/strings/escaping.h"

namespace candela {

std::string sha256(std::string_view bytes) {
  unsigned char digest[EVP_MAX_MD_SIZE];
  size_t size = 0;
  if (EVP_Q_digest(nullptr, "SHA256", nullptr, bytes.data(), bytes.size(), digest, &size) != 1) return {};
  return std::string(reinterpret_cast<const char*>(digest), size);
}

std::string sha256_hex(std::string_view bytes) { return absl::BytesToHexString(sha256(bytes)); }

}  // namespace candela
