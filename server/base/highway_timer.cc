// In place of a function of Highway's library: when it is loaded, it measures its timer for 3 ms, for
// benchmarks that Candela has not. Each program lists this file, because nothing would take it from a
// library.
#include <hwy/nanobenchmark.h>

uint64_t hwy::platform::TimerResolution() { return 1; }
