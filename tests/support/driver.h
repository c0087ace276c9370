// The Vulkan driver under the sanitizers.
#pragma once

namespace candela::testing {

// The software driver leaks a little when it is unloaded, which it is with the last instance: this keeps one.
void keep_driver_loaded();

}  // namespace candela::testing
