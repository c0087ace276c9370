// What Mesa's software driver has to be told before Vulkan starts.
#pragma once

namespace candela {

// Sets, where the user has not: LP_NUM_THREADS to usable_cpus(), at most lavapipe's own 32, where these are
// fewer than the visible ones (lavapipe counts only the latter); NODEVICE_SELECT=1, which keeps Mesa's
// device-select layer from reordering devices. Calls setenv: before other threads read the environment.
void prepare_driver_environment();

}  // namespace candela
