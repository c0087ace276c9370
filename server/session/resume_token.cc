#include "server/session/resume_token.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/rand.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"
#include "server/base/digest.h"
#include "server/base/option_file.h"
#include "server/base/status_macros.h"
#include "server/session/resume_token.pb.h"

namespace candela {
namespace {

// The layout of a token: version, key id, length of the body in two bytes, body, and the HMAC-SHA256 of all
// of that.
constexpr char kTokenVersion = 1;
constexpr size_t kKeyIdBytes = 8;
constexpr size_t kHeadBytes = 1 + kKeyIdBytes + 2;
constexpr size_t kMacBytes = 32;
constexpr size_t kSettingsHashBytes = 16;
constexpr size_t kMaxKeyFileBytes = 64 << 10;

// Empty if OpenSSL fails, which create() rules out.
std::string hmac(const std::string& key, std::string_view bytes) {
  unsigned char mac[kMacBytes];
  size_t size = 0;
  const auto* data = reinterpret_cast<const unsigned char*>(bytes.data());
  if (EVP_Q_mac(nullptr, "HMAC", nullptr, "SHA256", nullptr, key.data(), key.size(), data, bytes.size(), mac,
                sizeof mac, &size) == nullptr) {
    return {};
  }
  return std::string(reinterpret_cast<const char*>(mac), size);
}

bool equal_in_constant_time(std::string_view a, std::string_view b) {
  return a.size() == b.size() && CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

absl::Status refused(const std::string& why) {
  return absl::FailedPreconditionError(
      absl::StrCat("resume_token ", why, "; open the session without a token and send its frames again"));
}

internal::ResumeBody body_of(const ResumePoint& point, absl::Time expires) {
  internal::ResumeBody body;
  body.set_session(point.session);
  body.set_epoch(point.epoch);
  body.set_sequence(point.sequence);
  body.set_settings_hash(point.settings_hash);
  body.set_expires_ns(absl::ToUnixNanos(expires));
  internal::ExposureBody& exposure = *body.mutable_exposure();
  exposure.set_begun(point.exposure.begun);
  exposure.set_sequence(point.exposure.sequence);
  exposure.set_media_time_ns(point.exposure.media_time_ns);
  exposure.set_exposure(point.exposure.exposed.exposure);
  exposure.set_target(point.exposure.exposed.target);
  exposure.set_before(point.exposure.before);
  exposure.set_cut(point.exposure.cut);
  exposure.set_cut_pending(point.exposure.cut_pending);
  if (point.exposure.print) {
    exposure.mutable_print()->Assign(point.exposure.print->begin(), point.exposure.print->end());
  }
  return body;
}

ResumePoint point_of(const internal::ResumeBody& body) {
  ResumePoint point{.session = body.session(),
                    .epoch = body.epoch(),
                    .sequence = body.sequence(),
                    .exposure = {},
                    .settings_hash = body.settings_hash()};
  const internal::ExposureBody& exposure = body.exposure();
  point.exposure = {.begun = exposure.begun(),
                    .sequence = exposure.sequence(),
                    .media_time_ns = exposure.media_time_ns(),
                    .exposed = {exposure.exposure(), exposure.target()},
                    .before = exposure.before(),
                    .cut = exposure.cut(),
                    .cut_pending = exposure.cut_pending(),
                    .print = std::nullopt};
  if (exposure.print_size() > 0) {
    std::copy(exposure.print().begin(), exposure.print().end(), point.exposure.print.emplace().begin());
  }
  return point;
}

}  // namespace

TokenKeys::Key TokenKeys::key_of(std::string bytes) {
  return {sha256(bytes).substr(0, kKeyIdBytes), std::move(bytes)};
}

absl::StatusOr<TokenKeys> TokenKeys::create(std::vector<Key> keys, absl::Duration ttl) {
  for (const Key& key : keys) {
    if (key.id.size() != kKeyIdBytes || hmac(key.bytes, "").size() != kMacBytes) {
      return absl::InternalError("OpenSSL has no HMAC-SHA256 here, which resume tokens need");
    }
  }
  return TokenKeys(std::move(keys), ttl);
}

absl::StatusOr<TokenKeys> TokenKeys::read(const std::string& path, absl::Duration ttl) {
  ASSIGN_OR_RETURN(const std::string text,
                   read_option_file("resume-keys", path, kMaxKeyFileBytes, Secrecy::kSecret));
  std::vector<Key> keys;
  int number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() || line[0] == '#') continue;
    const bool hex = line.size() % 2 == 0 && std::all_of(line.begin(), line.end(), absl::ascii_isxdigit);
    if (!hex || line.size() / 2 < kMinKeyBytes) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "resume-keys: line %d of %s is not a key of %d bytes or more in hex; make one with: "
          "openssl rand -hex %d",
          number, path, kMinKeyBytes, kMinKeyBytes));
    }
    if (keys.size() == kMaxKeys) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "resume-keys: %s holds more than %d keys; remove the keys whose tokens have expired", path,
          kMaxKeys));
    }
    keys.push_back(key_of(absl::HexStringToBytes(line)));
  }
  if (keys.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "resume-keys: %s holds no key; make one with: openssl rand -hex %d", path, kMinKeyBytes));
  }
  return create(std::move(keys), ttl);
}

absl::StatusOr<TokenKeys> TokenKeys::random(absl::Duration ttl) {
  std::string bytes(kMinKeyBytes, '\0');
  if (RAND_bytes(reinterpret_cast<unsigned char*>(bytes.data()), static_cast<int>(bytes.size())) != 1) {
    return absl::InternalError("OpenSSL has no random numbers for a key; pass --resume-keys");
  }
  return create({key_of(std::move(bytes))}, ttl);
}

std::string TokenKeys::seal(const ResumePoint& point, absl::Time now) const {
  const Key& key = keys_.front();
  const std::string body = body_of(point, now + ttl_).SerializeAsString();
  const char size[2] = {static_cast<char>(body.size() >> 8), static_cast<char>(body.size())};
  std::string token = kTokenVersion + key.id + std::string(size, sizeof size) + body;
  token += hmac(key.bytes, token);
  return token;
}

absl::StatusOr<ResumePoint> TokenKeys::open(std::string_view token, const std::string& session,
                                            absl::Time now) const {
  if (token.size() > v1::kMaxTokenBytes) {
    return refused(
        absl::StrFormat("has %d bytes and a token has at most %d", token.size(), v1::kMaxTokenBytes));
  }
  if (!token.empty() && token[0] != kTokenVersion) {
    return refused("has another version than this server's tokens");
  }
  const auto byte = [&token](size_t i) { return static_cast<size_t>(static_cast<unsigned char>(token[i])); };
  const size_t body_bytes = token.size() < kHeadBytes ? 0 : byte(kHeadBytes - 2) << 8 | byte(kHeadBytes - 1);
  const size_t whole = kHeadBytes + body_bytes + kMacBytes;
  if (token.size() < whole) return refused(absl::StrFormat("is cut short after %d bytes", token.size()));
  if (token.size() > whole) return refused("has bytes behind its end");

  const std::string_view id = token.substr(1, kKeyIdBytes);
  const auto key = std::find_if(keys_.begin(), keys_.end(), [id](const Key& k) { return k.id == id; });
  if (key == keys_.end()) {
    return refused(
        "was signed with a key that this server does not have (servers share keys through --resume-keys)");
  }
  const std::string_view said = token.substr(0, token.size() - kMacBytes);
  if (!equal_in_constant_time(hmac(key->bytes, said), token.substr(said.size()))) {
    return refused("was changed after it was signed, or forged");
  }

  internal::ResumeBody body;
  const std::string_view bytes = said.substr(kHeadBytes);
  const int print_size = static_cast<int>(ScenePrint().size());
  if (!body.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())) ||
      (body.exposure().print_size() != 0 && body.exposure().print_size() != print_size)) {
    return refused("is signed correctly but this version cannot read it");
  }
  if (body.session() != session) {
    return refused(absl::StrFormat("belongs to another session than \"%s\"", session));
  }
  if (const absl::Time expired = absl::FromUnixNanos(body.expires_ns()); now >= expired) {
    return refused(absl::StrFormat("expired %s ago",
                                   absl::FormatDuration(absl::Trunc(now - expired, absl::Milliseconds(1)))));
  }
  return point_of(body);
}

std::string settings_hash(const google::protobuf::Message& settings) {
  return sha256(v1::deterministic_bytes(settings)).substr(0, kSettingsHashBytes);
}

namespace {

absl::Status check_picture(const v1::SessionState& state) {
  const int cells = static_cast<int>(ScenePrint().size());
  if (state.picture_size() != 0 && state.picture_size() != cells) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "open.state.picture has %d cells; it must have %d, or none", state.picture_size(), cells));
  }
  for (const float cell : state.picture()) {
    // A cell with nothing metered is NaN.
    if (std::isnan(cell) || (cell >= v1::kPictureEv.min && cell <= v1::kPictureEv.max)) continue;
    return absl::InvalidArgumentError(
        absl::StrFormat("open.state.picture has a cell of %g; a cell must be between %g and %g EV, or NaN",
                        cell, v1::kPictureEv.min, v1::kPictureEv.max));
  }
  return absl::OkStatus();
}

}  // namespace

v1::SessionState state_of(const ExposurePoint& point) {
  v1::SessionState state;
  state.set_sequence(point.sequence);
  state.set_media_time_ns(point.media_time_ns);
  state.set_exposure(point.exposed.exposure);
  state.set_target(point.exposed.target);
  state.set_cut_pending(point.cut_pending);
  if (point.print) state.mutable_picture()->Assign(point.print->begin(), point.print->end());
  return state;
}

absl::StatusOr<ExposurePoint> point_from(const v1::SessionState& state) {
  RETURN_IF_ERROR(check_factor("open.state.exposure", state.exposure()));
  RETURN_IF_ERROR(check_factor("open.state.target", state.target()));
  if (state.media_time_ns() < v1::kMediaTimeNs.min || state.media_time_ns() > v1::kMediaTimeNs.max) {
    return absl::InvalidArgumentError(
        absl::StrFormat("open.state.media_time_ns is %d; it must be between %d and %d", state.media_time_ns(),
                        v1::kMediaTimeNs.min, v1::kMediaTimeNs.max));
  }
  RETURN_IF_ERROR(check_picture(state));
  ExposurePoint point{.begun = true,
                      .sequence = state.sequence(),
                      .media_time_ns = state.media_time_ns(),
                      .exposed = {state.exposure(), state.target()},
                      .before = state.exposure(),
                      .cut_pending = state.cut_pending(),
                      .print = std::nullopt};
  if (state.picture_size() > 0) {
    std::copy(state.picture().begin(), state.picture().end(), point.print.emplace().begin());
  }
  return point;
}

}  // namespace candela
