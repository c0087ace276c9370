// Frames whose header says where they lie in a region. Internal to fuzz_wire.
#pragma once

#include "candela/v1/render.pb.h"
#include "server/session/render_start.h"

namespace candela {

// Whatever the offsets, what is taken lies inside the region. `start` is what the header was checked to be.
void place_in_memory(v1::FrameHeader header, const RenderStart& start);

}  // namespace candela
