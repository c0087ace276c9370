// The options for the size of images.
#pragma once

#include <CLI/App.hpp>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"
#include "client/run/options.h"
#include "proto/candela/v1/settings.h"

namespace candela {

// Defines --resize and --max-size. `setting` is output_size. Parsing fills `settings`, which outlives the
// app.
void add_size_options(CLI::App& app, v1::Settings& settings, const v1::SettingField& setting);

// Defines --desqueeze, for a command whose frames are files.
void add_desqueeze_option(CLI::App& app, PictureOptions& options);

// After parsing: refuses both of the first two.
absl::Status check_size_options(const v1::Settings& settings);

}  // namespace candela
