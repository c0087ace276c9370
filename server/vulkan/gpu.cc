#include "server/vulkan/gpu.h"

#include <system_error>

#include "absl/strings/match.h"

namespace candela {

bool has_gpu(const std::filesystem::path& devices) {
  std::error_code error;
  for (const char* const own : {"nvidiactl", "dxg"}) {
    if (std::filesystem::exists(devices / own, error)) return true;
  }
  for (std::filesystem::directory_iterator node(devices / "dri", error), end; !error && node != end;
       node.increment(error)) {
    if (absl::StartsWith(node->path().filename().string(), "renderD")) return true;
  }
  return false;
}

}  // namespace candela
