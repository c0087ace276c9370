// The options that stand for settings of the contract. They come from render.proto; only the options that set
// several settings at once, or that take a form of their own, are written by hand.
#pragma once

#include <CLI/App.hpp>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/settings.h"

namespace candela {

// Sections of the help that other options join.
inline constexpr char kExposureSection[] = "Exposure";
inline constexpr char kToneSection[] = "Tone";
inline constexpr char kOutputSection[] = "Output";

using SettingFilter = std::function<bool(const v1::SettingField&)>;

// Settings that change what `candela meter` finds out.
bool changes_metering(const v1::SettingField& setting);

// Defines an option for each setting that has a flag and passes the filter. Parsing fills `settings`, which
// outlives the app, with what the user gave and nothing else.
void add_settings_options(
    CLI::App& app, v1::Settings& settings,
    const SettingFilter& filter = [](const v1::SettingField&) { return true; });

// After parsing: finds settings that do not go together. A usage error.
absl::Status check_settings_options(const v1::Settings& settings);

// CIE xy of red, green, blue and white.
v1::Chromaticities to_message(const std::array<float, 8>& xy);

}  // namespace candela
