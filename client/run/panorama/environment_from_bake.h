// The server's bake as an environment that the client library can write.
#pragma once

#include "absl/status/statusor.h"
#include "client/environment.h"
#include "client/environment/baked_environment.h"

namespace candela {

// `handedness` is that of cube maps in files. RESOURCE_EXHAUSTED if there is not enough memory.
absl::StatusOr<BakedEnvironment> environment_from(const EnvironmentBake& bake, Handedness handedness);

}  // namespace candela
