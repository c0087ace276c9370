// Resume tokens: what a client keeps so that its session can go on elsewhere, signed so that nobody makes one
// up.
#pragma once

#include <google/protobuf/message.h>

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/session/exposure_track.h"

namespace candela {

// What a resume token says: where a session stood after a result.
struct ResumePoint {
  std::string session;  // at most v1::kMaxSessionNameBytes
  uint64_t epoch = 0;
  uint64_t sequence = 0;  // of the last frame that was answered, by a result or a failure
  ExposurePoint exposure;
  std::string settings_hash;  // 16 bytes
  std::string tier;           // a tier's name
};

inline constexpr size_t kMinKeyBytes = 32;
inline constexpr size_t kMaxKeys = 16;
inline constexpr absl::Duration kDefaultResumeTtl = absl::Minutes(10);

// The keys of resume tokens. The first one signs and all of them verify, so that a key is replaced without an
// interruption: add the new one below on every server, move it to the top, and take the old one out once its
// last tokens have expired. Signed is not encrypted: a token's holder can read it. Any thread.
class TokenKeys {
 public:
  // One key a line, in hex, kMinKeyBytes or more each; lines that begin with # and empty ones are skipped.
  // `ttl` is how long a token is good. Fails as read_option_file, and with INVALID_ARGUMENT naming the line
  // for what is no key. No message holds a part of a key.
  static absl::StatusOr<TokenKeys> read(const std::string& path, absl::Duration ttl = kDefaultResumeTtl);
  // One key of this process's own: its tokens are of no use to another server.
  static absl::StatusOr<TokenKeys> random(absl::Duration ttl = kDefaultResumeTtl);

  // A token of at most v1::kMaxTokenBytes that is good before `now` + ttl.
  std::string seal(const ResumePoint& point, absl::Time now) const;
  // FAILED_PRECONDITION, in words that tell them apart, for a token that is too long, cut short, of another
  // version, signed with a key that is not here, changed or made up, expired, or of another session than
  // `session`.
  absl::StatusOr<ResumePoint> open(std::string_view token, const std::string& session, absl::Time now) const;

 private:
  struct Key {
    std::string id;  // first bytes of its SHA-256
    std::string bytes;
  };

  TokenKeys(std::vector<Key> keys, absl::Duration ttl) : keys_(std::move(keys)), ttl_(ttl) {}
  static Key key_of(std::string bytes);
  static absl::StatusOr<TokenKeys> create(std::vector<Key> keys, absl::Duration ttl);

  std::vector<Key> keys_;  // at least one
  absl::Duration ttl_;
};

// 16 bytes that tell settings apart: of the SHA-256 of the deterministic serialisation.
std::string settings_hash(const google::protobuf::Message& settings);

}  // namespace candela
