// The rows of the commands. Each is defined in the command's own file, and main.cc lists them.
#pragma once

#include "client/cli/command_line.h"

namespace candela {

extern const Command kRenderCommand, kContactCommand, kStreamCommand, kMeterCommand, kViewCommand,
    kEnvironmentCommand, kSampleCommand, kReportCommand, kBenchCommand, kInfoCommand, kHealthCommand;

// Renders a sequence. `meter` calls it, too: its encoding is NONE, so there are no images.
absl::Status run_stream(const StreamOptions& options, JsonOutput& json);

}  // namespace candela
