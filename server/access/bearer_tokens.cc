#include "server/access/bearer_tokens.h"

#include <openssl/crypto.h>
#include <openssl/sha.h>

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "server/base/option_file.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMaxTokenFileBytes = 64 << 10;
constexpr absl::string_view kScheme = "Bearer ";
constexpr char kMakeOne[] = "openssl rand -hex 32";

std::array<unsigned char, SHA256_DIGEST_LENGTH> digest_of(absl::string_view token) {
  std::array<unsigned char, SHA256_DIGEST_LENGTH> digest;
  SHA256(reinterpret_cast<const unsigned char*>(token.data()), token.size(), digest.data());
  return digest;
}

}  // namespace

absl::StatusOr<BearerTokens> BearerTokens::read(const std::string& path) {
  ASSIGN_OR_RETURN(const std::string text,
                   read_option_file("token-file", path, kMaxTokenFileBytes, Secrecy::kSecret));
  BearerTokens tokens;
  int number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() || line[0] == '#') continue;
    if (line.size() < kMinBearerBytes) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "token-file: line %d of %s has %d characters and a token has at least %d; make one with: %s",
          number, path, line.size(), kMinBearerBytes, kMakeOne));
    }
    if (!std::all_of(line.begin(), line.end(), absl::ascii_isgraph)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("token-file: line %d of %s holds a space or a character that is not visible ASCII; "
                          "make a token with: %s",
                          number, path, kMakeOne));
    }
    if (tokens.digests_.size() == kMaxBearerTokens) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "token-file: %s holds more than %d tokens; remove the unused ones", path, kMaxBearerTokens));
    }
    tokens.digests_.push_back(digest_of(line));
  }
  if (tokens.digests_.empty()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("token-file: %s holds no token; make one with: %s", path, kMakeOne));
  }
  return tokens;
}

bool BearerTokens::allow(absl::string_view authorization) const {
  const absl::string_view scheme = authorization.substr(0, kScheme.size());
  if (!absl::EqualsIgnoreCase(scheme, kScheme)) return false;
  const Digest digest = digest_of(authorization.substr(kScheme.size()));
  bool found = false;
  for (const Digest& known : digests_) {
    found |= CRYPTO_memcmp(known.data(), digest.data(), digest.size()) == 0;
  }
  return found;
}

}  // namespace candela
