// The bearer tokens that allow their holders to call a server.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace candela {

inline constexpr size_t kMinBearerBytes = 16;
inline constexpr size_t kMaxBearerTokens = 64;

// Keeps only the SHA-256 of each token. Any thread.
class BearerTokens {
 public:
  // Reads one token per line, each of kMinBearerBytes or more visible ASCII characters. Empty lines and lines
  // that begin with # are skipped. All tokens are valid, so one can be replaced without an interruption.
  // Fails as read_option_file does for the option token-file, and with INVALID_ARGUMENT and the line number.
  // No message contains a part of a token.
  static absl::StatusOr<BearerTokens> read(const std::string& path);

  // Whether the value of the "authorization" metadata is "Bearer TOKEN" with one of the tokens. The time that
  // it takes does not depend on which token matches.
  bool allow(absl::string_view authorization) const;

  bool operator==(const BearerTokens&) const = default;

 private:
  using Digest = std::array<unsigned char, 32>;
  std::vector<Digest> digests_;
};

}  // namespace candela
