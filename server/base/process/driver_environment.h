// Environment variables for Mesa's drivers, set before Vulkan starts.
#pragma once

namespace candela {

// Sets two variables unless the user has set them:
// - LP_NUM_THREADS to usable_cpus(), at most lavapipe's own limit of 32, if fewer CPUs are usable than
// visible.
//   lavapipe itself counts the visible ones.
// - NODEVICE_SELECT=1, which keeps Mesa's device-select layer from reordering devices.
// Calls setenv, so call it before other threads read the environment.
void prepare_driver_environment();

}  // namespace candela
