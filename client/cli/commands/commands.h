// The subcommands. Each prints what it did, unless --quiet is set, and returns its failure. It returns a
// usage error (see usage.h) if a wrong option only shows while it works. `json` is the destination of --json;
// the command opens it after it has checked its outputs, and closes it if it succeeds.
#pragma once

#include "absl/status/status.h"
#include "client/cli/files/json_output.h"
#include "client/cli/options/options.h"

namespace candela {

absl::Status run_render(const RenderOptions& options, JsonOutput& json);
absl::Status run_stream(const StreamOptions& options, JsonOutput& json);
absl::Status run_meter(const MeterOptions& options, JsonOutput& json);
absl::Status run_view(const PanoramaViewOptions& options, JsonOutput& json);
absl::Status run_environment(const EnvironmentOptions& options, JsonOutput& json);
absl::Status run_bench(const BenchOptions& options, JsonOutput& json);
absl::Status run_sample(const SampleOptions& options);
absl::Status run_report(const ReportOptions& options);
absl::Status run_info(const InfoOptions& options, JsonOutput& json);
absl::Status run_health(const HealthOptions& options);

}  // namespace candela
