#include "server/render/self_test.h"

#include <half.h>

#include <array>
#include <cmath>
#include <cstring>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/base/digest.h"
#include "server/base/status_macros.h"
#include "server/render/color/aces.h"
#include "server/render/reference/verify.h"

namespace candela {

namespace {

// Odd on both sides, three tiles, with dark, bright and negative texels.
constexpr FrameDesc kDesc = {131, 37, kUsualFormat};
constexpr double kMaxCodes = 0.5 + 0.5;  // the second half is the image's rounding to 8 bits
constexpr double kMaxEv = 2e-5;
constexpr uint32_t kAcesPoints = 17;  // an axis
constexpr float kAcesEnd = 32.0f;

// Its numbers are exact: functions of the C libraries differ in the last bit, and the digest must not.
std::vector<std::byte> test_frame() {
  std::vector<std::array<half, 4>> texels(size_t{kDesc.width} * kDesc.height);
  for (uint32_t y = 0; y < kDesc.height; ++y) {
    for (uint32_t x = 0; x < kDesc.width; ++x) {
      const float light = std::ldexp(1.0f + static_cast<float>(x % 8) / 8.0f, static_cast<int>(x / 8) - 10);
      const float tint = static_cast<float>(y) / static_cast<float>(kDesc.height);
      texels[size_t{y} * kDesc.width + x] = {light, light * tint, light * (1 - tint) - 0.001f, tint};
    }
  }
  std::vector<std::byte> wire(kDesc.bytes());
  std::memcpy(wire.data(), texels.data(), wire.size());
  return wire;
}

void add(std::string& all, const void* bytes, size_t size) {
  all.append(static_cast<const char*>(bytes), size);
}
template <typename T>
void add(std::string& all, const T& number) {
  add(all, &number, sizeof number);
}

// The image and the statistics of a rendered frame, by their bits.
void add_frame(std::string& all, const FrameMemory& memory, const FrameReport& report) {
  for (uint32_t y = 0; y < kDesc.height; ++y) {
    const std::span<const std::byte> row = memory.output_row(y);
    add(all, row.data(), row.size());
  }
  const FrameStats& stats = report.stats;
  add(all, stats.mean_log2_luminance);
  add(all, stats.min_luminance);
  add(all, stats.max_luminance);
  for (const uint64_t count : {stats.nan_components, stats.infinite_components, stats.clamped_components,
                               stats.negative_components, stats.negative_scene_components,
                               stats.absent_pixels, stats.metered_weight, report.gamut_cut_components}) {
    add(all, count);
  }
  for (const float light : stats.tile_light) add(all, light);
  for (const float cell : stats.print) add(all, std::isnan(cell) ? -1000.0f : cell);
  add(all, report.exposure);
}

struct TestFrame {
  FrameMemory memory;
  FrameReport report;
};

absl::StatusOr<TestFrame> render_test_frame(Renderer& renderer, const Settings& settings) {
  const std::vector<std::byte> wire = test_frame();
  ASSIGN_OR_RETURN(FrameMemory memory, renderer.allocate(kDesc, settings));
  for (uint32_t y = 0; y < kDesc.height; ++y) {
    std::memcpy(memory.input_row(y).data(), wire.data() + y * kDesc.row_bytes(), kDesc.row_bytes());
  }
  ASSIGN_OR_RETURN(FrameReport report, renderer.render(memory, settings));
  return TestFrame{std::move(memory), std::move(report)};
}

// These differ most from the default settings.
absl::StatusOr<Settings> other_settings() {
  v1::Settings settings;
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  settings.set_curve(v1::TONE_CURVE_AGX);
  settings.set_transfer(v1::TRANSFER_GAMMA22);
  settings.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
  return Settings::from(settings);
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

absl::StatusOr<std::string> self_test(Renderer& renderer) {
  ASSIGN_OR_RETURN(TestFrame usual, render_test_frame(renderer, Settings()));
  if (const absl::Status held = hold_to_reference(usual.memory, usual.report); !held.ok()) {
    return absl::InternalError(
        absl::StrFormat("self-test: %s: this device or its driver computes wrongly; choose another --device",
                        std::string(held.message())));
  }
  std::string all;
  add_frame(all, usual.memory, usual.report);
  // On the device this would compile more pipelines.
  if (renderer.executor_kind() == ExecutorKind::kHost) {
    ASSIGN_OR_RETURN(const Settings other, other_settings());
    ASSIGN_OR_RETURN(const TestFrame frame, render_test_frame(renderer, other));
    add_frame(all, frame.memory, frame.report);
  }
  std::vector<float> light = lattice_light(kAcesPoints, shader::AXES_ACES, kAcesEnd);
  // Without it the device renders everything else.
  const absl::Status aces = aces_1(light);
  absl::StrAppend(&all, aces.message());
  if (aces.ok()) add(all, light.data(), light.size() * sizeof(float));
  return sha256_hex(all);
}

}  // namespace candela
