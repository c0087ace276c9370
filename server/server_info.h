// The server information that GetServerInfo returns.
#pragma once

#include "candela/v1/render.pb.h"
#include "server/config.h"
#include "server/device_keeper.h"
#include "server/vulkan/device.h"

namespace candela {

// The frames that the server accepts: limited by `config` and by the device.
FrameLimits frame_limits(const Config& config, const DeviceSummary& device);

// The answer to GetServerInfo, without the parts that change while the server runs.
v1::GetServerInfoResponse server_info(const Config& config, const RenderDevice& device);

}  // namespace candela
