// The options for settings of the contract. They are made from render.proto. Only options that set several
// settings at once, or that have a special form, are written by hand.
#pragma once

#include <CLI/App.hpp>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/settings.h"

namespace candela {

// Sections of the help that other options join.
inline constexpr char kInputSection[] = "Input";
inline constexpr char kExposureSection[] = "Exposure";
inline constexpr char kToneSection[] = "Tone";
inline constexpr char kOutputSection[] = "Output";

using SettingFilter = std::function<bool(const v1::SettingField&)>;

// Whether the setting changes the result of `candela meter`, for an image or a sequence.
bool changes_metering(const v1::SettingField& setting);

// Defines an option for each setting that has a flag and passes the filter. Parsing fills `settings`, which
// outlives the app, with what the user gave and nothing else.
void add_settings_options(
    CLI::App& app, v1::Settings& settings,
    const SettingFilter& filter = [](const v1::SettingField&) { return true; });

// After parsing: refuses settings that conflict, with a usage error.
absl::Status check_settings_options(const v1::Settings& settings);

}  // namespace candela
