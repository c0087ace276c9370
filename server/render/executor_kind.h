// Who makes the passes of a frame.
#pragma once

#include <array>
#include <cstdint>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace candela {

enum class ExecutorKind : uint32_t {
  kAuto,    // the host where the device is a CPU and the host can make them, else the device
  kDevice,  // the Vulkan device
  kHost,    // the host's processors, in the device's textures
};

inline constexpr std::array<const char*, 3> kExecutorWords = {"auto", "device", "host"};

inline const char* executor_word(ExecutorKind executor) {
  return kExecutorWords[static_cast<uint32_t>(executor)];
}

inline absl::StatusOr<ExecutorKind> parse_executor(absl::string_view word) {
  for (uint32_t i = 0; i < kExecutorWords.size(); ++i) {
    if (word == kExecutorWords[i]) return static_cast<ExecutorKind>(i);
  }
  return absl::InvalidArgumentError("it must be auto, device or host");
}

}  // namespace candela
