// How a frame is rendered: the contract's settings, complete and checked.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "server/render/settings/frame.h"
#include "server/render/settings/tiers.h"
#include "shaders/color_table.h"

namespace candela {

// Immutable and cheap to copy. Any thread. Ranges and defaults stand at the fields of candela.v1.Settings;
// every number, choice and text has a value here, except those that the contract leaves absent.
class Settings {
 public:
  Settings();  // every default

  // Gives absent settings their defaults and checks them all. INVALID_ARGUMENT names the field, its value and
  // what it may be; for an unknown tier it lists those there are.
  static absl::StatusOr<Settings> from(v1::Settings message);

  // The completed message, without the values of its table.
  const v1::Settings* operator->() const { return &state_->message; }
  const v1::Settings& operator*() const { return state_->message; }

  const Tier& tier() const { return *state_->tier; }
  // The settings' own table, for the curve TABLE alone.
  const std::shared_ptr<const ColorTable>& table() const { return state_->table; }
  // Row by row, from the wire's linear RGB to the scene's linear Rec.709; absent if it would change nothing.
  const std::optional<std::array<float, 9>>& to_scene() const { return state_->to_scene; }
  // The frame's statistics are to hold a histogram.
  bool wants_histogram() const { return state_->wants_histogram; }
  // The tier is to be chosen by a promise; see choose_tier().
  bool has_promise() const { return state_->message.has_max_error_codes() || state_->message.has_max_ms(); }

  // A copy that renders with another tier, which exists.
  Settings with_tier(const std::string& name) const;
  // The same for a frame of the server's own that stands for the client's: its spot is the whole frame.
  Settings for_measuring(const Tier& tier, const FrameDesc& desc) const;
  // A copy for a frame that is only metered: with a histogram, without bloom and promises.
  Settings for_metering() const;

  // Tells apart settings whose frames differ in time or error: the SHA-256, in hex, of every setting that the
  // contract does not mark `not_measured`.
  std::string measurement_key() const;

 private:
  struct State {
    v1::Settings message;
    const Tier* tier = nullptr;
    std::shared_ptr<const ColorTable> table;
    std::optional<std::array<float, 9>> to_scene;
    bool wants_histogram = false;
  };
  explicit Settings(std::shared_ptr<const State> state) : state_(std::move(state)) {}

  std::shared_ptr<const State> state_;
};

// The transfer that resolve encodes with: none for display-linear output; for a client's own table the curve
// by which its values became light.
v1::Transfer output_transfer(const v1::Settings& settings);

// INVALID_ARGUMENT if the settings do not fit this frame: a spot that lies beside it.
absl::Status check_settings_for(const Settings& settings, const FrameDesc& desc);

}  // namespace candela
