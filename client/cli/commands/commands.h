// The subcommands. Each prints what it did, unless --quiet is set, and returns its failure. It returns a
// usage error (see usage.h) if a wrong option only shows while it works.
#pragma once

#include "absl/status/status.h"
#include "client/cli/options/options.h"

namespace candela {

absl::Status run_render(const RenderOptions& options);
absl::Status run_stream(const StreamOptions& options);
absl::Status run_meter(const MeterOptions& options);
absl::Status run_view(const PanoramaViewOptions& options);
absl::Status run_environment(const EnvironmentOptions& options);
absl::Status run_bench(const BenchOptions& options);
absl::Status run_sample(const SampleOptions& options);
absl::Status run_report(const ReportOptions& options);
absl::Status run_info(const InfoOptions& options);
absl::Status run_health(const HealthOptions& options);

}  // namespace candela
