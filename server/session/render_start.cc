#include "server/session/render_start.h"

#include <optional>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr uint64_t kMaxRowPaddingBytes = 4096;

absl::Status check_format(v1::PixelFormat format) {
  if (format != v1::PIXEL_FORMAT_UNSPECIFIED && v1::PixelFormat_IsValid(format)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "frame.format is %d; it must be one of RGBA16F (1), RGBA32F (2), RGB9E5 (3), RGB16F (4) and RGB32F (5)",
      static_cast<int>(format)));
}

// `desc` has passed check_frame, so no product here overflows 64 bits.
absl::StatusOr<uint64_t> row_stride(const v1::FrameHeader& header, const FrameDesc& desc) {
  const uint64_t tight = uint64_t{desc.width} * bytes_per_pixel(header.format());
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
  RETURN_IF_ERROR(check_previous(previous));
  return previous;
}

absl::StatusOr<std::optional<double>> given_from(const v1::RenderStart& start) {
  if (!start.frame().has_exposure()) return std::nullopt;
  const double given = start.frame().exposure();
  RETURN_IF_ERROR(check_factor("frame.exposure", given));
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

// The server renders a view as a frame of halves.
absl::StatusOr<WireLayout> view_layout_from(const v1::FrameHeader& header, const FrameLimits& limits) {
  if (header.format() != v1::PIXEL_FORMAT_UNSPECIFIED || header.row_stride_bytes() != 0 ||
      header.total_bytes() != 0) {
    return absl::InvalidArgumentError(
        "frame.view is set, and so is frame.format, row_stride_bytes or "
        "total_bytes; a view has no pixels on the wire, so leave them out");
  }
  const FrameDesc desc{header.width(), header.height(), v1::PIXEL_FORMAT_RGBA16F};
  RETURN_IF_ERROR(check_frame(desc, limits));
  return WireLayout{desc, desc.format, desc.row_bytes(), header.may_leave_out_alpha()};
}

}  // namespace

absl::StatusOr<WireLayout> wire_layout_from(const v1::FrameHeader& header, const FrameLimits& limits) {
  if (header.has_view()) return view_layout_from(header, limits);
  RETURN_IF_ERROR(check_format(header.format()));
  const FrameDesc desc{header.width(), header.height(), with_alpha(header.format())};
  RETURN_IF_ERROR(check_frame(desc, limits));
  ASSIGN_OR_RETURN(const uint64_t stride, row_stride(header, desc));
  return WireLayout{desc, header.format(), stride, header.may_leave_out_alpha()};
}

absl::Status check_primaries_for_view(const Settings& settings) {
  const bool rec709 = settings->input_primaries() == v1::PRIMARIES_UNSPECIFIED ||
                      settings->input_primaries() == v1::PRIMARIES_REC709;
  if (rec709 && !settings->has_input_chromaticities()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      "settings.input_primaries or input_chromaticities are set for a view; its "
      "light is Rec.709, so leave them out, and give the panorama's when it is put");
}

absl::StatusOr<RenderStart> render_start_from(const v1::RenderRequest& request, const FrameLimits& limits) {
  if (!request.has_start()) {
    return absl::InvalidArgumentError("first message holds no `start`; send it before the bands");
  }
  const v1::RenderStart& start = request.start();

  ASSIGN_OR_RETURN(const WireLayout layout, wire_layout_from(start.frame(), limits));
  ASSIGN_OR_RETURN(Settings settings, Settings::from(start.settings()));
  RETURN_IF_ERROR(check_settings_for(settings, layout.desc, limits.max_dimension));
  ASSIGN_OR_RETURN(std::optional<PreviousExposure> previous, previous_from(start));
  ASSIGN_OR_RETURN(const std::optional<double> given, given_from(start));
  ASSIGN_OR_RETURN(const Verify verify, verify_from(start));
  if (start.frame().has_view()) {
    RETURN_IF_ERROR(check_primaries_for_view(settings));
  }
  return RenderStart{.layout = layout,
                     .sequence = start.frame().sequence(),
                     .settings = std::move(settings),
                     .previous = previous,
                     .given = given,
                     .verify = verify};
}

}  // namespace candela
