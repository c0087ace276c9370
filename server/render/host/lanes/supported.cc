#include "server/render/host/lanes/supported.h"

#include "server/render/host/lanes/targets.h"
// Only after targets.h.
#include <hwy/targets.h>

namespace candela::host {

const char* instruction_set() {
  const int64_t targets = hwy::SupportedTargets() & HWY_TARGETS;
  if ((targets & HWY_AVX3) != 0) return "AVX-512";
  if ((targets & HWY_AVX2) != 0) return "AVX2";
  return (targets & HWY_NEON) != 0 ? "NEON" : nullptr;
}

}  // namespace candela::host
