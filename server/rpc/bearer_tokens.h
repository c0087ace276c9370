// Bearer tokens: who has one of them may call.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace candela {

inline constexpr size_t kMinBearerBytes = 16;
inline constexpr size_t kMaxBearerTokens = 64;

// Kept as their SHA-256. Any thread.
class BearerTokens {
 public:
  // One a line, kMinBearerBytes or more, of visible ASCII; lines that begin with # and empty ones are
  // skipped. Any of them is good, so that one is replaced without an interruption. Fails as read_option_file
  // does, for the option token-file, and with INVALID_ARGUMENT naming the line. No message holds a part of a
  // token.
  static absl::StatusOr<BearerTokens> read(const std::string& path);

  // Whether the value of the "authorization" metadata is "Bearer TOKEN" with one of them. Takes as long for
  // each token, whichever fits.
  bool allow(absl::string_view authorization) const;

  bool operator==(const BearerTokens&) const = default;

 private:
  using Digest = std::array<unsigned char, 32>;
  std::vector<Digest> digests_;
};

}  // namespace candela
