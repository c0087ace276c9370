#include "server/session/render_start.h"

#include <cstring>
#include <memory>
#include <optional>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {

constexpr uint64_t kMaxRowPaddingBytes = 4096;

// Sets `field` to `value`; both enums have the same numbers. 0 keeps the default in `field`.
template <typename Ours, typename Theirs>
absl::Status set_enum(const char* name, Theirs value, bool known, Ours& field) {
  if (!known) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s is %d, which this server does not know; GetServerInfo lists what it does", name,
                        static_cast<int>(value)));
  }
  if (static_cast<int>(value) != 0) field = static_cast<Ours>(value);
  return absl::OkStatus();
}

absl::Status read_enums(const v1::Settings& message, Settings& settings) {
  const v1::Exposure::Mode mode = message.exposure().mode();
  absl::Status status =
      set_enum("exposure.mode", mode, v1::Exposure::Mode_IsValid(mode), settings.exposure.mode);
  status.Update(set_enum("curve", message.curve(), v1::ToneCurve_IsValid(message.curve()), settings.curve));
  status.Update(
      set_enum("transfer", message.transfer(), v1::Transfer_IsValid(message.transfer()), settings.transfer));
  status.Update(set_enum("output_format", message.output_format(),
                         v1::OutputFormat_IsValid(message.output_format()), settings.output_format));
  const v1::Metering& metering = message.exposure().metering();
  MeteringSettings& meter = settings.exposure.metering;
  status.Update(set_enum("exposure.metering.statistic", metering.statistic(),
                         v1::Metering::Statistic_IsValid(metering.statistic()), meter.statistic));
  status.Update(set_enum("exposure.metering.weights", metering.weights(),
                         v1::Metering::Weights_IsValid(metering.weights()), meter.weights));
  const v1::Adaptation::Domain domain = message.exposure().adaptation().domain();
  status.Update(set_enum("exposure.adaptation.domain", domain, v1::Adaptation::Domain_IsValid(domain),
                         settings.exposure.adaptation.domain));
  const v1::Bloom::Kind kind = message.bloom().kind();
  status.Update(set_enum("bloom.kind", kind, v1::Bloom::Kind_IsValid(kind), settings.bloom.kind));
  status.Update(set_enum("bad_values", message.bad_values(), v1::BadValues_IsValid(message.bad_values()),
                         settings.bad_values));
  return status;
}

// An odd byte at the end becomes one more value, which check_settings then refuses.
std::shared_ptr<const ColorTable> table_from(const v1::ColorTable& message) {
  const std::string& bytes = message.values();
  auto table = std::make_shared<ColorTable>();
  table->size = message.size();
  if (message.axes() != v1::ColorTable::AXES_UNSPECIFIED) table->axes = static_cast<uint32_t>(message.axes());
  table->end = message.has_end() ? message.end() : v1::kDefaultTableEnd;
  table->values.resize((bytes.size() + 1) / 2);
  if (!bytes.empty()) std::memcpy(table->values.data(), bytes.data(), bytes.size());
  return table;
}

absl::StatusOr<FrameDesc> frame_from(const v1::FrameHeader& header) {
  if (header.format() == v1::PIXEL_FORMAT_UNSPECIFIED || !v1::PixelFormat_IsValid(header.format())) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame.format is %d; it must be one of RGBA16F (1), RGBA32F (2) and RGB9E5 (3)",
                        static_cast<int>(header.format())));
  }
  return FrameDesc{header.width(), header.height(), static_cast<PixelFormat>(header.format())};
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

absl::StatusOr<Verify> verify_from(const v1::RenderStart& start) {
  if (!start.verify() && start.error_map()) {
    return absl::InvalidArgumentError("error_map is set and verify is not; set both, or neither");
  }
  return start.error_map() ? Verify::kWithMap : start.verify() ? Verify::kYes : Verify::kNo;
}

}  // namespace

absl::StatusOr<Settings> settings_from(const v1::Settings& message) {
  Settings settings;
  if (absl::Status status = read_enums(message, settings); !status.ok()) return status;

  const v1::Exposure& exposure = message.exposure();
  if (exposure.has_manual_ev()) settings.exposure.manual_ev = exposure.manual_ev();
  if (exposure.has_compensation_ev()) settings.exposure.compensation_ev = exposure.compensation_ev();
  if (exposure.has_key()) settings.exposure.key = exposure.key();
  if (exposure.has_min_exposure()) settings.exposure.min_exposure = exposure.min_exposure();
  if (exposure.has_max_exposure()) settings.exposure.max_exposure = exposure.max_exposure();

  const v1::Metering& metering = exposure.metering();
  MeteringSettings& meter = settings.exposure.metering;
  if (metering.has_percentile_low()) meter.percentile_low = metering.percentile_low();
  if (metering.has_percentile_high()) meter.percentile_high = metering.percentile_high();
  meter.spot = {metering.spot().x0(), metering.spot().y0(), metering.spot().x1(), metering.spot().y1()};
  const v1::Adaptation& adaptation = exposure.adaptation();
  if (adaptation.has_speed_up()) settings.exposure.adaptation.speed_up = adaptation.speed_up();
  if (adaptation.has_speed_down()) settings.exposure.adaptation.speed_down = adaptation.speed_down();

  const v1::Bloom& bloom = message.bloom();
  if (settings.bloom.kind == BloomKind::kGaussian) settings.bloom.threshold = v1::kDefaultGaussianThreshold;
  if (bloom.has_intensity()) settings.bloom.intensity = bloom.intensity();
  if (bloom.has_threshold()) settings.bloom.threshold = bloom.threshold();
  if (bloom.has_softness()) settings.bloom.softness = bloom.softness();
  if (bloom.has_levels()) settings.bloom.levels = bloom.levels();
  if (bloom.has_firefly_weights()) settings.bloom.firefly_weights = bloom.firefly_weights();

  if (message.has_curve_white()) settings.curve_white = message.curve_white();
  if (message.has_table()) settings.table = table_from(message.table());
  if (message.has_prescale()) settings.prescale = message.prescale();
  if (!message.tier().empty()) settings.tier = message.tier();
  if (message.has_max_error_codes()) settings.promise.max_error_codes = message.max_error_codes();
  if (message.has_max_ms()) settings.promise.max_ms = message.max_ms();
  if (settings.promise.given() && !message.tier().empty()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("tier is \"%s\" and there is a promise, max_error_codes or max_ms; the one chooses "
                        "what the other names",
                        message.tier()));
  }
  settings.dither = message.dither();
  if (message.input_primaries() != v1::PRIMARIES_UNSPECIFIED) {
    if (message.has_input_chromaticities()) {
      return absl::InvalidArgumentError(
          "both input_primaries and input_chromaticities are given; a frame has one of them");
    }
    auto primaries = Primaries::kRec709;
    if (absl::Status status = set_enum("input_primaries", message.input_primaries(),
                                       v1::Primaries_IsValid(message.input_primaries()), primaries);
        !status.ok()) {
      return status;
    }
    settings.input_chromaticities = chromaticities(primaries);
  }
  if (message.has_input_chromaticities()) {
    const v1::Chromaticities& c = message.input_chromaticities();
    settings.input_chromaticities = Chromaticities{
        {c.red_x(), c.red_y(), c.green_x(), c.green_y(), c.blue_x(), c.blue_y(), c.white_x(), c.white_y()}};
  }
  if (absl::Status status = check_settings(settings); !status.ok()) return status;
  return settings;
}

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
  absl::StatusOr<Settings> settings = settings_from(start.settings());
  if (!settings.ok()) return settings.status();
  if (absl::Status status = check_settings_for(*settings, layout->desc); !status.ok()) return status;
  absl::StatusOr<std::optional<PreviousExposure>> previous = previous_from(start);
  if (!previous.ok()) return previous.status();
  const absl::StatusOr<Verify> verify = verify_from(start);
  if (!verify.ok()) return verify.status();
  return RenderStart{
      layout->desc, start.frame().sequence(), layout->row_stride_bytes, *std::move(settings), *previous,
      *verify};
}

}  // namespace candela
