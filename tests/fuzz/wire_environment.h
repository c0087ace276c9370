// The calls about environments, as the server reads them. Internal to fuzz_wire.
#pragma once

#include "proto/candela/v1/limits.h"
#include "server/render/settings/settings.h"
#include "tests/fuzz/wire_input.h"

namespace candela {

inline constexpr FrameLimits kLimits{v1::kMaxDimension, v1::kDefaultMaxFrameBytes};

// Reads the messages as a PutEnvironment call.
void put_environment(const WireInput& input);
// Reads the first message as a BakeEnvironment request, and as the header of a frame that is a view.
void use_environment(const WireInput& input);

}  // namespace candela
