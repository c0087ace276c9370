// The first message of a Render call: what will come, and what is wanted of it.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "server/render/plan/exposure.h"
#include "server/render/renderer.h"
#include "server/render/settings/frame.h"
#include "server/render/settings/settings.h"

namespace candela {

struct RenderStart {
  FrameDesc desc;
  uint64_t sequence = 0;
  uint64_t row_stride_bytes = 0;  // at least desc.row_bytes()
  Settings settings;
  std::optional<PreviousExposure> previous;  // absent: the frame takes its target at once
  Verify verify = Verify::kNo;
};

// Reads and checks everything that can be checked before a pixel is there: check_frame, check_settings, the
// row stride and the total size. INVALID_ARGUMENT or RESOURCE_EXHAUSTED; takes no memory for the frame.
absl::StatusOr<RenderStart> read_render_start(grpc::ByteBuffer& message, const FrameLimits& limits);

// How a frame comes, as its header says.
struct FrameLayout {
  FrameDesc desc;
  uint64_t row_stride_bytes = 0;  // at least desc.row_bytes()
};

// check_frame, the row stride and the total size. INVALID_ARGUMENT or RESOURCE_EXHAUSTED.
absl::StatusOr<FrameLayout> frame_layout_from(const v1::FrameHeader& header, const FrameLimits& limits);

// The request that `message` holds; for messages without pixels. INVALID_ARGUMENT for one that is too long to
// be such a message, or damaged.
absl::Status parse_request(grpc::ByteBuffer& message, google::protobuf::Message& request);

// Absent fields take their defaults. INVALID_ARGUMENT for an enum's value that this server does not know, and
// as check_settings.
absl::StatusOr<Settings> settings_from(const v1::Settings& message);

}  // namespace candela
