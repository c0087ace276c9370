// Whether the host's kernels run on this processor.
#pragma once

namespace candela::host {

// "AVX2", "AVX-512" or "NEON", whichever they use; null if the processor has none with fused multiply-add, so
// that no kernel runs.
const char* instruction_set();

}  // namespace candela::host
