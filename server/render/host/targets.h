// Which instruction sets the host's kernels are compiled for. Include it before any header of Highway.
//
// Only those with fused multiply-add, so that the bits do not depend on the processor: AVX2, AVX-512 and
// NEON. On any other processor the device's passes serve.
#pragma once

// Highway's own names; they mean something only after its headers.
#define HWY_DISABLED_TARGETS \
  (HWY_SSSE3 | HWY_SSE4 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)

// Whether the code that is being compiled is for one of them. The baseline of the build may be another one.
#define CANDELA_HOST_TARGET (HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_NEON)
