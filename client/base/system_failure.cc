#include "client/base/system_failure.h"

#include <new>
#include <system_error>

#include "absl/strings/str_format.h"

namespace candela {

absl::Status system_failure(const std::exception& error) {
  if (dynamic_cast<const std::bad_alloc*>(&error) != nullptr) {
    return absl::ResourceExhaustedError(
        "out of memory; render a smaller image, or give this process more memory (ulimit -v)");
  }
  const auto* const system = dynamic_cast<const std::system_error*>(&error);
  if (system != nullptr && system->code() == std::errc::resource_unavailable_try_again) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "cannot start a thread: %s; allow this process more threads or memory (ulimit -u, ulimit -v)",
        system->code().message()));
  }
  return absl::InternalError(error.what());
}

}  // namespace candela
