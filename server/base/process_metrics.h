// What Prometheus's client libraries say about a process: process_*.
#pragma once

#include <prometheus/metric_family.h>

#include <vector>

namespace candela {

// CPU time, memory, descriptors, threads and start time of this process, as they are now. What the kernel
// does not tell is left out. Any thread.
std::vector<prometheus::MetricFamily> process_metrics();

}  // namespace candela
