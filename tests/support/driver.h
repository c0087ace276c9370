// The Vulkan driver under the sanitizers.
#pragma once

namespace candela::testing {

// Keeps a Vulkan instance for the rest of the process. The software driver is unloaded with the last instance
// and leaks a little then.
void keep_driver_loaded();

}  // namespace candela::testing
