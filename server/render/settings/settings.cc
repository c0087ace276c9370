#include "server/render/settings/settings.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/render/color/primaries.h"
#include "server/render/settings/gain_curve_of.h"
#include "server/render/settings/hdr_display.h"
#include "shaders/params.h"

namespace candela {

absl::Status check_frame(const FrameDesc& desc, const FrameLimits& limits) {
  if (desc.width == 0 || desc.height == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame is %dx%d pixels; both sides must be at least 1", desc.width, desc.height));
  }
  if (desc.width > limits.max_dimension || desc.height > limits.max_dimension) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "frame is %dx%d pixels and this server takes at most %d a side; scale it down or send it in parts",
        desc.width, desc.height, limits.max_dimension));
  }
  // This divides because the product may not fit into 64 bits.
  if (desc.row_bytes() > limits.max_frame_bytes / desc.height) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "frame is %d bytes (%dx%d %s) and this server takes at most %d; send %sfewer pixels", desc.bytes(),
        desc.width, desc.height, v1::word_of(desc.format), limits.max_frame_bytes,
        desc.format == v1::PIXEL_FORMAT_RGBA32F ? "half floats or " : ""));
  }
  return absl::OkStatus();
}

absl::Status check_output_size(const v1::OutputSize& size) {
  // Written so that NaN fails.
  if (size.has_percent() && !(size.percent() > 0 && size.percent() <= v1::kMaxOutputPercent)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("output_size.percent is %g; it must be above 0 and at most %g", size.percent(),
                        v1::kMaxOutputPercent));
  }
  if (size.has_pixel_aspect() &&
      !(size.pixel_aspect() >= v1::kPixelAspect.min && size.pixel_aspect() <= v1::kPixelAspect.max)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("output_size.pixel_aspect is %g; it must be between %g and %g", size.pixel_aspect(),
                        v1::kPixelAspect.min, v1::kPixelAspect.max));
  }
  const bool sides = size.width() > 0 || size.height() > 0;
  if (sides && size.has_percent()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("output_size.percent is %g and the size is %dx%d; give one of them", size.percent(),
                        size.width(), size.height()));
  }
  if (size.max_side() > 0 && (sides || size.has_percent())) {
    return absl::InvalidArgumentError(
        absl::StrFormat("output_size.max_side is %d and there is a %s, too; give one of them",
                        size.max_side(), sides ? "width or a height" : "percent"));
  }
  return absl::OkStatus();
}

ImageSize image_size(const v1::Settings& settings, const FrameDesc& desc) {
  return v1::image_size(settings.output_size(), {desc.width, desc.height});
}

bool resizes(const v1::Settings& settings, const FrameDesc& desc) {
  return image_size(settings, desc) != ImageSize{desc.width, desc.height};
}

namespace {

absl::Status check_exposure(const v1::Exposure& exposure) {
  if (exposure.min_exposure() > exposure.max_exposure()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "exposure.min_exposure is %g and exposure.max_exposure is %g; the minimum must not be larger",
        exposure.min_exposure(), exposure.max_exposure()));
  }
  const v1::Metering& metering = exposure.metering();
  if (metering.percentile_high() - metering.percentile_low() < v1::kLeastPercentileRange) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "exposure.metering.percentile_low is %g and percentile_high is %g; the low one must be smaller by %g "
        "or more",
        metering.percentile_low(), metering.percentile_high(), v1::kLeastPercentileRange));
  }
  if (const v1::Rectangle& spot = metering.spot(); metering.weights() == v1::Metering::WEIGHTS_SPOT &&
                                                   (spot.x0() >= spot.x1() || spot.y0() >= spot.y1())) {
    return absl::InvalidArgumentError(
        absl::StrFormat("exposure.metering.spot is x %d .. %d, y %d .. %d and holds no pixel; x0 must be "
                        "below x1 and y0 below y1",
                        spot.x0(), spot.x1(), spot.y0(), spot.y1()));
  }
  return absl::OkStatus();
}

absl::StatusOr<const Tier*> find_known_tier(const v1::Settings& message) {
  if (const Tier* tier = find_tier(message.tier()); tier != nullptr) return tier;
  return absl::InvalidArgumentError(absl::StrFormat(
      "tier is \"%s\"; there are: %s", message.tier(),
      absl::StrJoin(tiers(), ", ", [](std::string* out, const Tier& tier) { out->append(tier.name); })));
}

absl::Status check_table_fields(const v1::ColorTable& table) {
  if (!(table.size() >= v1::kTableSize.min && table.size() <= v1::kTableSize.max)) {
    return absl::InvalidArgumentError(absl::StrFormat("table.size is %d; it must be between %d and %d",
                                                      table.size(), v1::kTableSize.min, v1::kTableSize.max));
  }
  if (!v1::ColorTable::Axes_IsValid(table.axes())) {
    return absl::InvalidArgumentError(
        absl::StrFormat("table.axes is %d; it must be ACES (1), REC709 (2) or AP1 (3)", table.axes()));
  }
  if (table.has_end() && !(table.end() >= v1::kTableEnd.min && table.end() <= v1::kTableEnd.max)) {
    return absl::InvalidArgumentError(absl::StrFormat("table.end is %g; it must be between %g and %g",
                                                      table.end(), v1::kTableEnd.min, v1::kTableEnd.max));
  }
  const uint64_t points = uint64_t{table.size()} * table.size() * table.size();
  if (table.values().size() != points * 3 * sizeof(uint16_t)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("table.values is %d bytes; %d^3 points of 6 bytes are %d", table.values().size(),
                        table.size(), points * 3 * sizeof(uint16_t)));
  }
  return absl::OkStatus();
}

// The message's table, checked and in the form that the shaders use; null if the message has none.
absl::StatusOr<std::shared_ptr<const ColorTable>> table_from(const v1::Settings& message) {
  const bool wanted = message.curve() == v1::TONE_CURVE_TABLE;
  if (wanted && !message.has_table()) {
    return absl::InvalidArgumentError(
        "curve is TABLE and there is no table; send one, or choose another curve");
  }
  if (!message.has_table()) return nullptr;
  if (!wanted) {
    return absl::InvalidArgumentError(
        absl::StrFormat("there is a table and curve is %s; set curve to TABLE, or leave the table out",
                        v1::word_of(message.curve())));
  }
  RETURN_IF_ERROR(check_table_fields(message.table()));
  const std::string& bytes = message.table().values();
  auto table = std::make_shared<ColorTable>();
  table->size = message.table().size();
  if (message.table().axes() != v1::ColorTable::AXES_UNSPECIFIED) {
    table->axes = static_cast<uint32_t>(message.table().axes());
  }
  table->end = message.table().has_end() ? message.table().end() : v1::kDefaultTableEnd;
  table->values.resize(bytes.size() / sizeof(uint16_t));
  std::memcpy(table->values.data(), bytes.data(), bytes.size());
  return table;
}

// See Settings::table_step().
double largest_step(const ColorTable& table) {
  const size_t n = table.size;
  int largest = 0;
  for (size_t distance = 3; distance < table.values.size(); distance *= n) {  // along red, green and blue
    for (size_t i = 0; i + distance < table.values.size(); ++i) {
      if (i / distance % n == n - 1) continue;  // the last point along this axis
      largest = std::max(largest, std::abs(int{table.values[i]} - int{table.values[i + distance]}));
    }
  }
  return largest * double{shader::TABLE_MAX_ROOT} / 65535;
}

// From the frame's primaries, and the scene's white if it is balanced, to the scene.
absl::StatusOr<std::optional<std::array<float, 9>>> matrix_from(const v1::Settings& message) {
  const bool named = message.input_primaries() != v1::PRIMARIES_UNSPECIFIED;
  if (named && message.has_input_chromaticities()) {
    return absl::InvalidArgumentError(
        "both input_primaries and input_chromaticities are given; a frame has one of them");
  }
  if (message.has_tint() && !message.has_white_balance()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "tint is %g and there is no white_balance; give both, or leave the tint out", message.tint()));
  }
  return scene_matrix(message);
}

}  // namespace

Settings::Settings() {
  static const auto* const kDefaults = new Settings(*from({}));
  state_ = kDefaults->state_;
}

absl::StatusOr<Settings> Settings::from(v1::Settings message) {
  if (message.has_max_error_codes() && !message.tier().empty()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "tier is \"%s\" and max_error_codes is %g, which chooses the tier; give only one of the two",
        message.tier(), message.max_error_codes()));
  }
  RETURN_IF_ERROR(v1::complete_settings(message));
  RETURN_IF_ERROR(check_hdr_display(message));
  RETURN_IF_ERROR(check_exposure(message.exposure()));
  RETURN_IF_ERROR(check_output_size(message.output_size()));
  auto state = std::make_shared<State>();
  ASSIGN_OR_RETURN(state->tier, find_known_tier(message));
  ASSIGN_OR_RETURN(state->table, table_from(message));
  ASSIGN_OR_RETURN(state->to_scene, matrix_from(message));
  state->gain_curve = gain_curve_of(message, state->table);
  if (message.has_table()) message.mutable_table()->clear_values();
  state->message = std::move(message);
  if (state->table && state->message.has_max_error_codes()) state->table_step = largest_step(*state->table);
  return Settings(std::move(state));
}

Settings Settings::with_tier(const std::string& name) const {
  auto state = std::make_shared<State>(*state_);
  state->message.set_tier(name);
  state->tier = find_tier(name);
  CHECK(state->tier != nullptr);
  state->tier_is_chosen = true;
  return Settings(std::move(state));
}

Settings Settings::for_metering(bool histogram) const {
  auto state = std::make_shared<State>(*state_);
  state->message.clear_max_error_codes();
  state->message.mutable_bloom()->set_intensity(0);
  state->message.clear_output_size();
  state->message.clear_gain_map_peak_nits();
  state->gain_curve = nullptr;
  state->wants_histogram = histogram;
  return Settings(std::move(state));
}

Settings Settings::with_table_owner(std::shared_ptr<const void> owner) const {
  struct Owned {
    std::shared_ptr<const ColorTable> table;
    std::shared_ptr<const void> owner;
  };
  const auto owned = std::make_shared<const Owned>(Owned{state_->table, std::move(owner)});
  auto state = std::make_shared<State>(*state_);
  state->table = std::shared_ptr<const ColorTable>(owned, owned->table.get());
  return Settings(std::move(state));
}

v1::Transfer output_transfer(const v1::Settings& settings) {
  if (settings.curve() == v1::TONE_CURVE_TABLE) return v1::TRANSFER_SRGB;
  return settings.output_format() == v1::OUTPUT_FORMAT_RGBA16F ? v1::TRANSFER_LINEAR : settings.transfer();
}

bool is_hdr(const v1::Settings& settings) {
  return settings.transfer() == v1::TRANSFER_PQ || settings.transfer() == v1::TRANSFER_HLG;
}

absl::Status check_settings_for(const Settings& settings, const FrameDesc& desc, uint32_t max_dimension) {
  const v1::Metering& metering = settings->exposure().metering();
  if (metering.weights() == v1::Metering::WEIGHTS_SPOT &&
      (metering.spot().x0() >= desc.width || metering.spot().y0() >= desc.height)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("exposure.metering.spot begins at x %d, y %d, beside the frame of %dx%d pixels",
                        metering.spot().x0(), metering.spot().y0(), desc.width, desc.height));
  }
  if (const ImageSize image = image_size(*settings, desc);
      image.width > max_dimension || image.height > max_dimension) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "output_size makes an image of %dx%d pixels of a frame of %dx%d, and this server makes at "
        "most %d a side; ask for a smaller one",
        image.width, image.height, desc.width, desc.height, max_dimension));
  }
  return absl::OkStatus();
}

}  // namespace candela
