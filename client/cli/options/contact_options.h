// The options of `candela contact`: those of `candela render` that make sense for a sheet.
#pragma once

#include <CLI/App.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/run/options.h"

namespace candela {

struct ContactOptions : RenderOptions {
  uint32_t columns = 0;  // of the sheet; 0: as many as rows
};

struct ContactArguments {
  std::vector<std::string> files;  // inputs, then the sheet
  ContactOptions options;
};

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_contact_options(CLI::App& app, ContactArguments& arguments);

// After parsing: chooses the pictures' size and refuses options that conflict.
absl::Status finish_contact_options(ContactArguments& arguments);

}  // namespace candela
