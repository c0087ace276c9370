// Settings: completed and checked; a frame's format, and the size of its image.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/image_size.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/render/color/hdr_signal.h"
#include "server/render/settings/tiers.h"
#include "shaders/color_table.h"

namespace candela {

// A frame's size and pixel format on the wire, and the limits on them.

// A frame as its header describes it. Sizes are in pixels; `row_bytes` and `bytes` are without row padding.
struct FrameDesc {
  uint32_t width = 0;
  uint32_t height = 0;
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;

  uint64_t row_bytes() const { return uint64_t{width} * bytes_per_pixel(format); }
  uint64_t bytes() const { return row_bytes() * height; }
};

// The largest frame that a server accepts. `max_frame_bytes` is never more than the device can allocate.
struct FrameLimits {
  uint32_t max_dimension = 0;
  uint64_t max_frame_bytes = 0;
};

// INVALID_ARGUMENT for an empty frame, RESOURCE_EXHAUSTED for one over the limits. Allocates nothing.
absl::Status check_frame(const FrameDesc& desc, const FrameLimits& limits);

// The size of the image that is made of a frame.

using v1::ImageSize;

// INVALID_ARGUMENT if a field is out of its range, or given with another one that it does not go with.
absl::Status check_output_size(const v1::OutputSize& size);

// The image's size for a frame, docs/pipeline.md section 5; the frame's own without `output_size`. The
// settings have passed check_output_size. A side of more than UINT32_MAX is UINT32_MAX. Pure.
ImageSize image_size(const v1::Settings& settings, const FrameDesc& desc);

bool resizes(const v1::Settings& settings, const FrameDesc& desc);

// The settings of a frame, complete and checked. Immutable and cheap to copy. Any thread. Ranges and defaults
// are declared at the fields of candela.v1.Settings. Every number, choice and text has a value, except those
// that the contract leaves absent.
class Settings {
 public:
  Settings();  // every default

  // Gives absent settings their defaults and checks all of them. INVALID_ARGUMENT names the field, its value
  // and its range; for an unknown tier it lists the tiers.
  static absl::StatusOr<Settings> from(v1::Settings message);

  // The completed message, without the table's values.
  const v1::Settings* operator->() const { return &state_->message; }
  const v1::Settings& operator*() const { return state_->message; }

  const Tier& tier() const { return *state_->tier; }
  // The client's table; null unless the curve is TABLE.
  const std::shared_ptr<const ColorTable>& table() const { return state_->table; }
  // The matrix from the wire's linear RGB to the scene's linear Rec.709, row by row; absent if not needed.
  const std::optional<std::array<float, 9>>& to_scene() const { return state_->to_scene; }
  // Whether metering needs a histogram.
  bool wants_histogram() const { return state_->wants_histogram; }
  // Whether max_error_codes has still to choose the tier, for each frame; until then tier() means nothing.
  bool tier_is_open() const { return state_->message.has_max_error_codes() && !state_->tier_is_chosen; }
  // What makes the image an HDR one; null without gain_map_peak_nits.
  const std::shared_ptr<const GainCurve>& gain_curve() const { return state_->gain_curve; }
  // The largest difference of a root between neighbours of the client's table, 0 .. TABLE_MAX_ROOT; 0 without
  // one, and without max_error_codes.
  double table_step() const { return state_->table_step; }

  // A copy with another tier, which was chosen if there is max_error_codes. `name` must be a tier.
  Settings with_tier(const std::string& name) const;
  // A copy for a frame that is only metered: without bloom, promises and another size, and with a histogram
  // if it is wanted.
  Settings for_metering(bool histogram) const;

  // A copy that keeps `owner` as long as anyone uses the client's table, which there must be.
  Settings with_table_owner(std::shared_ptr<const void> owner) const;

 private:
  struct State {
    v1::Settings message;
    const Tier* tier = nullptr;
    std::shared_ptr<const ColorTable> table;
    std::shared_ptr<const GainCurve> gain_curve;
    std::optional<std::array<float, 9>> to_scene;
    bool wants_histogram = false;
    bool tier_is_chosen = false;
    double table_step = 0.0;
  };
  explicit Settings(std::shared_ptr<const State> state) : state_(std::move(state)) {}

  std::shared_ptr<const State> state_;
};

// The transfer that resolve encodes with. Display-linear output has none. For a client's table it is the
// transfer from which the table's values were decoded.
v1::Transfer output_transfer(const v1::Settings& settings);

// Whether the image is for an HDR display: complete settings whose transfer is PQ or HLG.
bool is_hdr(const v1::Settings& settings);

// INVALID_ARGUMENT if the metering spot begins outside the frame; RESOURCE_EXHAUSTED if a side of the image
// has more than `max_dimension` pixels.
absl::Status check_settings_for(const Settings& settings, const FrameDesc& desc, uint32_t max_dimension);

}  // namespace candela
