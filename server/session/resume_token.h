// Resume tokens. A client keeps the last one to continue its session on another call or server. Tokens are
// signed, so nobody can forge one.
#pragma once

#include <google/protobuf/message.h>

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "server/session/exposure_track.h"

namespace candela {

// The contents of a resume token: the state of a session after a result.
struct ResumePoint {
  std::string session;  // at most v1::kMaxSessionNameBytes
  uint64_t epoch = 0;
  uint64_t sequence = 0;  // of the last frame that was answered, with a result or a failure
  ExposurePoint exposure;
  std::string settings_hash;  // 16 bytes
};

inline constexpr size_t kMinKeyBytes = 32;
inline constexpr size_t kMaxKeys = 16;
inline constexpr absl::Duration kDefaultResumeTtl = absl::Minutes(10);

// The keys of resume tokens. The first key signs and all keys verify. To replace a key without an
// interruption, append the new one on every server, then move it to the top, and remove the old one when its
// last tokens have expired. Tokens are not encrypted: whoever holds one can read it. Any thread.
class TokenKeys {
 public:
  // Reads one key per line, in hex, each of kMinKeyBytes or more. Empty lines and lines that begin with # are
  // skipped. `ttl` is how long a token is valid. Fails as read_option_file does, and with INVALID_ARGUMENT
  // and the line number if a line is not a key. No message contains a part of a key.
  static absl::StatusOr<TokenKeys> read(const std::string& path, absl::Duration ttl = kDefaultResumeTtl);
  // Makes a random key. Its tokens are valid only in this process.
  static absl::StatusOr<TokenKeys> random(absl::Duration ttl = kDefaultResumeTtl);

  // Returns a token of at most v1::kMaxTokenBytes that is valid until `now` + ttl.
  std::string seal(const ResumePoint& point, absl::Time now) const;
  // FAILED_PRECONDITION, with a different message for each case, if the token is too long, truncated, of
  // another version, signed with an unknown key, changed or forged, expired, or does not belong to `session`.
  absl::StatusOr<ResumePoint> open(std::string_view token, const std::string& session, absl::Time now) const;

 private:
  struct Key {
    std::string id;  // the first bytes of the SHA-256 of `bytes`
    std::string bytes;
  };

  TokenKeys(std::vector<Key> keys, absl::Duration ttl) : keys_(std::move(keys)), ttl_(ttl) {}
  static Key key_of(std::string bytes);
  static absl::StatusOr<TokenKeys> create(std::vector<Key> keys, absl::Duration ttl);

  std::vector<Key> keys_;  // at least one
  absl::Duration ttl_;
};

// A hash that identifies settings: 16 bytes of the SHA-256 of their deterministic serialisation.
std::string settings_hash(const google::protobuf::Message& settings);

// A session's exposure as clients keep it: the SessionState of render.proto.

// The state after a frame. `point` has begun.
v1::SessionState state_of(const ExposurePoint& point);

// The point that a new session continues after. A client may claim any state, so every value is checked:
// INVALID_ARGUMENT with the field, its value and its range.
absl::StatusOr<ExposurePoint> point_from(const v1::SessionState& state);

}  // namespace candela
