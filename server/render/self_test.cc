#include "server/render/self_test.h"

#include <half.h>

#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"
#include "server/render/reference/verify.h"

namespace candela {

namespace {

// Odd on both sides, three tiles, with dark, bright and negative texels.
constexpr FrameDesc kDesc = {131, 37, kUsualFormat};
constexpr double kMaxCodes = 0.5 + 0.5;  // the second half is the image's rounding to 8 bits
constexpr double kMaxEv = 2e-5;

std::vector<std::byte> test_frame() {
  std::vector<std::array<half, 4>> texels(size_t{kDesc.width} * kDesc.height);
  for (uint32_t y = 0; y < kDesc.height; ++y) {
    for (uint32_t x = 0; x < kDesc.width; ++x) {
      const float light = std::exp2(static_cast<float>(x) / 8.0f - 10.0f);
      const float tint = static_cast<float>(y) / static_cast<float>(kDesc.height);
      texels[size_t{y} * kDesc.width + x] = {light, light * tint, light * (1 - tint) - 0.001f, tint};
    }
  }
  std::vector<std::byte> wire(kDesc.bytes());
  std::memcpy(wire.data(), texels.data(), wire.size());
  return wire;
}

}  // namespace

absl::Status hold_to_reference(FrameMemory& memory, const FrameReport& report) {
  const FrameVerification verification = verify_frame(memory, report.plan, report.stats);
  const Verification& error = verification.rounded;
  const FrameStats& truth = verification.truth;
  const bool counts = report.stats.nan_components == truth.nan_components &&
                      report.stats.infinite_components == truth.infinite_components &&
                      report.stats.clamped_components == truth.clamped_components &&
                      report.stats.negative_components == truth.negative_components;
  if (error.meter_error_ev <= kMaxEv && error.max_codes <= kMaxCodes && counts) return absl::OkStatus();
  return absl::InternalError(
      absl::StrFormat("the frame is %g codes off the reference (at most %g is right), worst at x %d, y %d, "
                      "its metering %g EV (at most "
                      "%g), its counts of NaN, infinite and negative components are %s",
                      error.max_codes, kMaxCodes, error.worst_x, error.worst_y, error.meter_error_ev, kMaxEv,
                      counts ? "right" : "wrong"));
}

absl::Status self_test(Renderer& renderer) {
  const std::vector<std::byte> wire = test_frame();
  const Settings settings;
  ASSIGN_OR_RETURN(FrameMemory memory, renderer.allocate(kDesc, settings));
  for (uint32_t y = 0; y < kDesc.height; ++y) {
    std::memcpy(memory.input_row(y).data(), wire.data() + y * kDesc.row_bytes(), kDesc.row_bytes());
  }
  ASSIGN_OR_RETURN(const FrameReport report, renderer.render(memory, settings));
  const absl::Status held = hold_to_reference(memory, report);
  if (held.ok()) return held;
  return absl::InternalError(
      absl::StrFormat("self-test: %s: this device or its driver computes wrongly; choose another --device",
                      std::string(held.message())));
}

}  // namespace candela
