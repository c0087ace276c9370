// The start message of a Render call, checked, and the parts that it shares with a session.
#pragma once

#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "server/render/frame/frame_memory.h"
#include "server/render/plan/exposure.h"
#include "server/render/settings/settings.h"

namespace candela {

// The size and layout of a frame, as its header gives them.
struct WireLayout {
  FrameDesc desc;                    // as the server keeps it: the format has an alpha
  v1::PixelFormat format;            // on the wire; desc.format is with_alpha() of it
  uint64_t row_stride_bytes;         // of bands of pixels; at least row_bytes()
  bool may_leave_out_alpha = false;  // of the image, if it is 1

  uint64_t row_bytes() const { return uint64_t{desc.width} * bytes_per_pixel(format); }
};

struct RenderStart {
  WireLayout layout;
  uint64_t sequence = 0;
  Settings settings;
  std::optional<PreviousExposure> previous;  // absent: the frame is rendered with its target exposure
  std::optional<double> given;               // the frame's own exposure; then there is no `previous`
  Verify verify = Verify::kNo;
};

// Checks everything that can be checked before the pixels arrive: check_frame, Settings::from, the row stride
// and the total size. INVALID_ARGUMENT or RESOURCE_EXHAUSTED. Allocates no memory for the frame.
absl::StatusOr<RenderStart> render_start_from(const v1::RenderRequest& request, const FrameLimits& limits);

// check_frame, the row stride and the total size; of a view, the frame that the server renders it as.
// INVALID_ARGUMENT or RESOURCE_EXHAUSTED.
absl::StatusOr<WireLayout> wire_layout_from(const v1::FrameHeader& header, const FrameLimits& limits);

// A view's light has Rec.709 primaries: INVALID_ARGUMENT if the settings say anything else.
absl::Status check_primaries_for_view(const Settings& settings);

}  // namespace candela
