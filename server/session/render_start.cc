#include "server/session/render_start.h"

#include <optional>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {

constexpr uint64_t kMaxRowPaddingBytes = 4096;

absl::StatusOr<FrameDesc> frame_from(const v1::FrameHeader& header) {
  if (header.format() == v1::PIXEL_FORMAT_UNSPECIFIED || !v1::PixelFormat_IsValid(header.format())) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame.format is %d; it must be one of RGBA16F (1), RGBA32F (2) and RGB9E5 (3)",
                        static_cast<int>(header.format())));
  }
  return FrameDesc{header.width(), header.height(), header.format()};
}

// `desc` has passed check_frame, so no product here overflows 64 bits.
absl::StatusOr<uint64_t> row_stride(const v1::FrameHeader& header, const FrameDesc& desc) {
  const uint64_t tight = desc.row_bytes();
  const uint64_t stride = header.row_stride_bytes() == 0 ? tight : header.row_stride_bytes();
  if (stride < tight || stride > tight + kMaxRowPaddingBytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame.row_stride_bytes is %d; rows of %d pixels need %d and may take at most %d",
                        stride, desc.width, tight, tight + kMaxRowPaddingBytes));
  }
  if (header.total_bytes() != 0 && header.total_bytes() != stride * desc.height) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame.total_bytes is %d; %d rows of %d bytes are %d (or leave it 0)",
                        header.total_bytes(), desc.height, stride, stride * desc.height));
  }
  return stride;
}

absl::StatusOr<std::optional<PreviousExposure>> previous_from(const v1::RenderStart& start) {
  if (!start.has_previous()) return std::nullopt;
  const PreviousExposure previous{start.previous().exposure(), start.previous().elapsed_seconds()};
  if (absl::Status status = check_previous(previous); !status.ok()) return status;
  return previous;
}

absl::StatusOr<std::optional<double>> given_from(const v1::RenderStart& start) {
  if (!start.frame().has_exposure()) return std::nullopt;
  const double given = start.frame().exposure();
  if (absl::Status status = check_factor("frame.exposure", given); !status.ok()) return status;
  if (start.has_previous()) {
    return absl::InvalidArgumentError(
        "frame.exposure and previous are both set; a frame takes the first or adapts from the second");
  }
  return given;
}

absl::StatusOr<Verify> verify_from(const v1::RenderStart& start) {
  if (!start.verify() && start.error_map()) {
    return absl::InvalidArgumentError("error_map is set and verify is not; set both, or neither");
  }
  return start.error_map() ? Verify::kWithMap : start.verify() ? Verify::kYes : Verify::kNo;
}

}  // namespace

absl::StatusOr<WireLayout> wire_layout_from(const v1::FrameHeader& header, const FrameLimits& limits) {
  absl::StatusOr<FrameDesc> desc = frame_from(header);
  if (!desc.ok()) return desc.status();
  if (absl::Status status = check_frame(*desc, limits); !status.ok()) return status;
  const absl::StatusOr<uint64_t> stride = row_stride(header, *desc);
  if (!stride.ok()) return stride.status();
  return WireLayout{*desc, *stride};
}

absl::StatusOr<RenderStart> render_start_from(const v1::RenderRequest& request, const FrameLimits& limits) {
  if (!request.has_start()) {
    return absl::InvalidArgumentError("first message holds no `start`; send it before the bands");
  }
  const v1::RenderStart& start = request.start();

  const absl::StatusOr<WireLayout> layout = wire_layout_from(start.frame(), limits);
  if (!layout.ok()) return layout.status();
  absl::StatusOr<Settings> settings = Settings::from(start.settings());
  if (!settings.ok()) return settings.status();
  if (absl::Status status = check_settings_for(*settings, layout->desc); !status.ok()) return status;
  absl::StatusOr<std::optional<PreviousExposure>> previous = previous_from(start);
  if (!previous.ok()) return previous.status();
  const absl::StatusOr<std::optional<double>> given = given_from(start);
  if (!given.ok()) return given.status();
  const absl::StatusOr<Verify> verify = verify_from(start);
  if (!verify.ok()) return verify.status();
  return RenderStart{.desc = layout->desc,
                     .sequence = start.frame().sequence(),
                     .row_stride_bytes = layout->row_stride_bytes,
                     .settings = *std::move(settings),
                     .previous = *previous,
                     .given = *given,
                     .verify = *verify};
}

}  // namespace candela
