// The id of an environment, which the server and its clients compute alike.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "absl/strings/string_view.h"
#include "candela/v1/render.pb.h"

namespace candela::v1 {

// The SHA-256 of a line of text, which says what the pixels mean, and of the pixels in the order of their
// rows, without padding. Movable.
class EnvironmentId {
 public:
  // Uses the size, the format, the primaries and the treatment of bad values of `start`. Defaults that are
  // absent and defaults that are named give the same id.
  explicit EnvironmentId(const EnvironmentStart& start);
  EnvironmentId(EnvironmentId&&) noexcept;
  EnvironmentId& operator=(EnvironmentId&&) noexcept;
  ~EnvironmentId();

  void add(std::span<const std::byte> pixels);
  // 64 hex digits. Call it once, after the last pixel.
  std::string finish();

 private:
  struct Digest;
  std::unique_ptr<Digest> digest_;
};

// Whether `id` is 64 hex digits, in lower case.
bool is_environment_id(absl::string_view id);

}  // namespace candela::v1
