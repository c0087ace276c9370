#include "server/session/render_start.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "proto/candela/v1/limits.h"
#include "server/rpc/band_reader.h"
#include "tests/support/status.h"

namespace candela {
namespace {

constexpr FrameLimits kLimits{v1::kMaxDimension, v1::kDefaultMaxFrameBytes};

v1::RenderRequest request(uint32_t width, uint32_t height,
                          v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F) {
  v1::RenderRequest message;
  v1::FrameHeader& frame = *message.mutable_start()->mutable_frame();
  frame.set_sequence(42);
  frame.set_width(width);
  frame.set_height(height);
  frame.set_format(format);
  return message;
}

absl::StatusOr<RenderStart> read(const v1::RenderRequest& message, const FrameLimits& limits = kLimits) {
  return render_start_from(message, limits);
}

absl::StatusCode code(const v1::RenderRequest& message) { return read(message).status().code(); }

TEST(RenderStart, AFrameWithoutAlphaIsKeptWithOne) {
  ASSERT_OK_AND_ASSIGN(const RenderStart start, read(request(5, 3, v1::PIXEL_FORMAT_RGB16F)));
  EXPECT_EQ(start.layout.desc.format, v1::PIXEL_FORMAT_RGBA16F);
  EXPECT_EQ(start.layout.row_bytes(), 30u);
  EXPECT_EQ(start.layout.row_stride_bytes, 30u);
  ASSERT_OK_AND_ASSIGN(const RenderStart wide, read(request(5, 3, v1::PIXEL_FORMAT_RGB32F)));
  EXPECT_EQ(wide.layout.desc.format, v1::PIXEL_FORMAT_RGBA32F);
  EXPECT_EQ(wide.layout.row_bytes(), 60u);
}

TEST(RenderStart, AbsentSettingsTakeTheDefaults) {
  ASSERT_OK_AND_ASSIGN(const RenderStart start, read(request(5, 3)));
  EXPECT_EQ(start.sequence, 42u);
  EXPECT_EQ(start.layout.desc.width, 5u);
  EXPECT_EQ(start.layout.desc.height, 3u);
  EXPECT_EQ(start.layout.row_stride_bytes, 40u);
  EXPECT_EQ(start.settings->exposure().mode(), v1::Exposure::MODE_AUTO);
  EXPECT_EQ(start.settings->exposure().key(), 0.18);
  EXPECT_EQ(start.settings->bloom().intensity(), 0.05f);
  EXPECT_EQ(start.settings->bloom().levels(), 5u);
  EXPECT_TRUE(start.settings->bloom().firefly_weights());
  EXPECT_EQ(start.settings->curve(), v1::TONE_CURVE_ACES_HILL);
  EXPECT_EQ(start.settings->output_format(), v1::OUTPUT_FORMAT_RGBA8);
  EXPECT_EQ(start.settings->tier(), "standard");
  EXPECT_FALSE(start.settings.to_scene());
}

TEST(RenderStart, GivenSettingsArriveAsTheyAre) {
  v1::RenderRequest message = request(1, 1);
  v1::Settings& settings = *message.mutable_start()->mutable_settings();
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.mutable_exposure()->set_manual_ev(-2.5);
  settings.mutable_bloom()->set_intensity(0);
  settings.mutable_bloom()->set_firefly_weights(false);
  settings.set_curve(v1::TONE_CURVE_REINHARD);
  settings.set_transfer(v1::TRANSFER_LINEAR);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  settings.set_bad_values(v1::BAD_VALUES_REJECT);
  settings.set_prescale(1.5);
  ASSERT_OK_AND_ASSIGN(const RenderStart start, read(message));
  EXPECT_EQ(start.settings->exposure().mode(), v1::Exposure::MODE_MANUAL);
  EXPECT_EQ(start.settings->exposure().manual_ev(), -2.5);
  EXPECT_EQ(start.settings->bloom().intensity(), 0.0f);
  EXPECT_FALSE(start.settings->bloom().firefly_weights());
  EXPECT_EQ(start.settings->curve(), v1::TONE_CURVE_REINHARD);
  EXPECT_EQ(start.settings->transfer(), v1::TRANSFER_LINEAR);
  EXPECT_EQ(start.settings->output_format(), v1::OUTPUT_FORMAT_RGBA16F);
  EXPECT_EQ(start.settings->bad_values(), v1::BAD_VALUES_REJECT);
  EXPECT_EQ(start.settings->prescale(), 1.5);
}

TEST(RenderStart, VerificationIsReadAndAMapNeedsIt) {
  v1::RenderRequest message = request(1, 1);
  EXPECT_EQ(read(message)->verify, Verify::kNo);
  message.mutable_start()->set_verify(true);
  EXPECT_EQ(read(message)->verify, Verify::kYes);
  message.mutable_start()->set_error_map(true);
  EXPECT_EQ(read(message)->verify, Verify::kWithMap);
  message.mutable_start()->set_verify(false);
  EXPECT_REFUSED(kInvalidArgument, "verify", read(message));
}

v1::RenderRequest table_request(uint32_t size, size_t bytes) {
  v1::RenderRequest message = request(1, 1);
  v1::Settings& settings = *message.mutable_start()->mutable_settings();
  settings.set_curve(v1::TONE_CURVE_TABLE);
  settings.mutable_table()->set_size(size);
  settings.mutable_table()->set_values(std::string(bytes, '\1'));
  return message;
}

TEST(RenderStart, ATableArrivesAsItIs) {
  v1::RenderRequest message = table_request(2, 48);
  v1::ColorTable& table = *message.mutable_start()->mutable_settings()->mutable_table();
  (*table.mutable_values())[2] = '\2';
  ASSERT_OK_AND_ASSIGN(const RenderStart start, read(message));
  ASSERT_NE(start.settings.table(), nullptr);
  EXPECT_EQ(start.settings.table()->size, 2u);
  EXPECT_EQ(start.settings.table()->axes, shader::AXES_ACES);
  EXPECT_EQ(start.settings.table()->end, 32.0f);
  EXPECT_EQ(start.settings.table()->values[0], 0x0101);
  EXPECT_EQ(start.settings.table()->values[1], 0x0102);
  table.set_axes(v1::ColorTable::AXES_REC709);
  table.set_end(100.0f);
  EXPECT_EQ(read(message)->settings.table()->axes, shader::AXES_REC709);
  EXPECT_EQ(read(message)->settings.table()->end, 100.0f);
  table.set_axes(v1::ColorTable::AXES_AP1);
  EXPECT_EQ(read(message)->settings.table()->axes, shader::AXES_AP1);
}

TEST(RenderStart, TheLargestTableFits) {
  EXPECT_EQ(code(table_request(65, v1::kMaxTableBytes)), absl::StatusCode::kOk);
}

TEST(RenderStart, RefusesBadTables) {
  const auto refused = [](const char* part, const v1::RenderRequest& message) {
    EXPECT_REFUSED(kInvalidArgument, part, read(message));
  };
  refused("table.size is 0", table_request(0, 0));
  refused("table.size is 1", table_request(1, 6));
  refused("table.size is 66", table_request(66, 6));
  refused("table.size is 4294967295", table_request(0xffffffffu, 6));
  refused("table.values is 0 bytes", table_request(2, 0));
  refused("table.values is 46 bytes", table_request(2, 46));
  refused("table.values is 47 bytes", table_request(2, 47));
  refused("table.values is 49 bytes", table_request(2, 49));
  refused("table.values is 54 bytes", table_request(2, 54));
  for (float end : {0.0f, -1.0f, 65505.0f, NAN}) {
    v1::RenderRequest message = table_request(2, 48);
    message.mutable_start()->mutable_settings()->mutable_table()->set_end(end);
    refused("table.end is ", message);
  }
  v1::RenderRequest message = table_request(2, 48);
  v1::Settings& settings = *message.mutable_start()->mutable_settings();
  settings.mutable_table()->set_axes(static_cast<v1::ColorTable::Axes>(4));
  refused("table.axes is 4", message);
  settings.mutable_table()->clear_axes();
  settings.set_curve(v1::TONE_CURVE_ACES_1);
  refused("there is a table and curve is aces-1", message);
  settings.set_curve(v1::TONE_CURVE_TABLE);
  settings.clear_table();
  refused("curve is TABLE and there is no table", message);
}

TEST(RenderStart, RefusesEmptyAndOversizedFrames) {
  EXPECT_EQ(code(request(0, 1)), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(request(1, 0)), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(request(16384, 1)), absl::StatusCode::kOk);
  EXPECT_EQ(code(request(16385, 1)), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(code(request(1, 16385)), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(code(request(16384, 4096)), absl::StatusCode::kOk);  // 512 MiB exactly
  EXPECT_EQ(code(request(16384, 4097)), absl::StatusCode::kResourceExhausted);
}

TEST(RenderStart, SizesWhoseProductsLeave32BitsDoNotWrap) {
  // 65536 x 65536 x 8 is 0 in 32 bits. The square of 2^32-1 times 16 does not fit into 64 bits.
  for (uint32_t side : {65536u, 0x80000000u, 0xffffffffu}) {
    for (v1::PixelFormat format :
         {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
      EXPECT_EQ(code(request(side, side, format)), absl::StatusCode::kResourceExhausted) << side;
    }
  }
}

TEST(RenderStart, RowStrideIsBetweenTheTightRowAnd4096BytesMore) {
  v1::RenderRequest message = request(10, 4);
  v1::FrameHeader& frame = *message.mutable_start()->mutable_frame();
  for (const auto& [stride, good] : {std::pair(79u, false), std::pair(80u, true), std::pair(83u, true),
                                     std::pair(80u + 4096, true), std::pair(81u + 4096, false)}) {
    frame.set_row_stride_bytes(stride);
    EXPECT_EQ(read(message).ok(), good) << stride;
  }
  frame.set_row_stride_bytes(100);
  frame.set_total_bytes(400);
  EXPECT_OK(read(message));
  for (uint64_t total : {uint64_t{320}, uint64_t{401}, ~uint64_t{0}}) {
    frame.set_total_bytes(total);
    EXPECT_EQ(code(message), absl::StatusCode::kInvalidArgument) << total;
  }
}

TEST(RenderStart, RefusesUnknownEnumValuesByName) {
  const auto refused = [](const char* field, const std::function<void(v1::RenderStart&)>& set) {
    v1::RenderRequest message = request(1, 1);
    set(*message.mutable_start());
    EXPECT_REFUSED(kInvalidArgument, field, read(message));
  };
  using Start = v1::RenderStart;
  refused("frame.format", [](Start& s) { s.mutable_frame()->set_format(v1::PIXEL_FORMAT_UNSPECIFIED); });
  refused("frame.format", [](Start& s) { s.mutable_frame()->set_format(static_cast<v1::PixelFormat>(99)); });
  refused("exposure.mode", [](Start& s) {
    s.mutable_settings()->mutable_exposure()->set_mode(static_cast<v1::Exposure::Mode>(9));
  });
  refused("curve", [](Start& s) { s.mutable_settings()->set_curve(static_cast<v1::ToneCurve>(-1)); });
  refused("transfer", [](Start& s) { s.mutable_settings()->set_transfer(static_cast<v1::Transfer>(77)); });
  refused("output_format",
          [](Start& s) { s.mutable_settings()->set_output_format(static_cast<v1::OutputFormat>(4)); });
  refused("bad_values",
          [](Start& s) { s.mutable_settings()->set_bad_values(static_cast<v1::BadValues>(3)); });
  refused("tier", [](Start& s) { s.mutable_settings()->set_tier("splendid"); });
}

TEST(RenderStart, RefusesNonFiniteAndOutOfRangeSettings) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  for (double bad : {std::nan(""), kInf, -kInf, 1e300, -1e300}) {
    const auto refused = [bad](const std::function<void(v1::Settings&, double)>& set) {
      v1::RenderRequest message = request(1, 1);
      set(*message.mutable_start()->mutable_settings(), bad);
      EXPECT_EQ(code(message), absl::StatusCode::kInvalidArgument) << message.ShortDebugString();
    };
    refused([](v1::Settings& s, double v) { s.mutable_exposure()->set_manual_ev(v); });
    refused([](v1::Settings& s, double v) { s.mutable_exposure()->set_compensation_ev(v); });
    refused([](v1::Settings& s, double v) { s.mutable_exposure()->set_key(v); });
    refused([](v1::Settings& s, double v) { s.mutable_exposure()->set_min_exposure(v); });
    refused([](v1::Settings& s, double v) { s.mutable_exposure()->set_max_exposure(v); });
    refused([](v1::Settings& s, double v) { s.mutable_bloom()->set_intensity(static_cast<float>(v)); });
    refused([](v1::Settings& s, double v) { s.mutable_bloom()->set_threshold(static_cast<float>(v)); });
    refused([](v1::Settings& s, double v) { s.mutable_bloom()->set_softness(static_cast<float>(v)); });
    refused([](v1::Settings& s, double v) { s.set_prescale(v); });
    refused([](v1::Settings& s, double v) {
      s.mutable_input_chromaticities()->set_red_x(static_cast<float>(v));
    });
  }
}

TEST(RenderStart, RefusesWhatIsNotAStart) {
  const auto refused = [](const std::string& bytes) {
    const grpc::Slice slice(bytes);
    grpc::ByteBuffer buffer(&slice, 1);
    v1::RenderRequest message;
    const absl::Status parsed = parse_request(buffer, message);
    EXPECT_TRUE(absl::IsInvalidArgument(parsed.ok() ? read(message).status() : parsed));
  };
  refused("");
  refused("\xff\xff\xff\xff");
  refused(std::string(65537, '\0'));
  v1::RenderRequest band;
  band.mutable_band()->set_pixels("12345678");
  refused(band.SerializeAsString());
  const std::string whole = request(1, 1).SerializeAsString();
  refused(whole.substr(0, whole.size() - 1));
}

}  // namespace
}  // namespace candela
