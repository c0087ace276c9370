// Meter reports the same as Render, without an image.
#include <half.h>

#include <cmath>
#include <cstring>
#include <numeric>

#include "tests/service/service_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

class Meter : public ServiceTest {
 protected:
  static grpc::Status meter(const WireFrame& frame, const v1::Settings& settings,
                            v1::MeterResponse* response) {
    grpc::ClientContext context;
    const auto stub = v1::RenderService::NewStub(channel());
    const auto writer = stub->Meter(&context, response);
    v1::RenderRequest start = start_of(frame);
    *start.mutable_start()->mutable_settings() = settings;
    writer->Write(start);
    writer->Write(band_of(frame, 0, frame.desc.height));
    writer->WritesDone();
    return writer->Finish();
  }
};
// The sum of the alphas of a frame of halves, in 255 steps each.
uint64_t weight_of(const WireFrame& frame) {
  uint64_t weight = 0;
  for (size_t at = 6; at < frame.pixels.size(); at += 8) {
    uint16_t bits;
    std::memcpy(&bits, &frame.pixels[at], sizeof bits);
    weight += static_cast<uint64_t>(std::lround(255 * imath_half_to_float(bits)));
  }
  return weight;
}
INSTANTIATE_TEST_SUITE_P(Transport, Meter, ::testing::Bool(), transport_name);

TEST_P(Meter, SaysWhatRenderSaysOfTheSameFrame) {
  const WireFrame frame = natural(131, 67);
  ASSERT_GT(weight_of(frame), 255u);
  for (const auto statistic : {v1::Metering::STATISTIC_LOG_AVERAGE, v1::Metering::STATISTIC_PERCENTILE}) {
    v1::Settings settings;
    settings.mutable_exposure()->mutable_metering()->set_statistic(statistic);
    v1::MeterResponse metered;
    ASSERT_OK(meter(frame, settings, &metered));
    ASSERT_OK_AND_ASSIGN(const RenderResult rendered, connection().render(settings, view(frame)));
    EXPECT_EQ(metered.exposure(), rendered.header.exposure());
    EXPECT_EQ(metered.target(), rendered.header.target());
    EXPECT_EQ(metered.statistics().SerializeAsString(), rendered.header.statistics().SerializeAsString());
    EXPECT_EQ(std::accumulate(metered.histogram().begin(), metered.histogram().end(), uint64_t{0}),
              weight_of(frame));
  }
}

TEST_P(Meter, HistogramHasAFlatFrameInItsBin) {
  v1::MeterResponse metered;
  ASSERT_OK(meter(flat(40, 30, {2.0f, 2.0f, 2.0f, 1.0f}), {}, &metered));
  const auto bin = static_cast<int>((1.0 - metered.histogram_first_ev()) * metered.histogram_bins_per_ev());
  // Luminance weights add up to 1 except for rounding, so it may also be the bin below.
  EXPECT_EQ(metered.histogram(bin) + metered.histogram(bin - 1), 1200u);
}

TEST_P(Meter, LeavesOutAbsentPixelsAndSaysWhatALimitHeld) {
  WireFrame frame = make_frame(40, 30, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t) -> Texel {
    return x < 10 ? Texel{2.0f, 2.0f, 2.0f, 1.0f} : Texel{0, 0, 0, 0};
  });
  v1::Settings settings;
  settings.mutable_exposure()->set_min_exposure(0.25);
  v1::MeterResponse metered;
  ASSERT_OK(meter(frame, settings, &metered));
  EXPECT_EQ(metered.statistics().absent_pixels(), 900u);
  EXPECT_NEAR(metered.statistics().mean_log2_luminance(), 1.0, 2e-5);
  EXPECT_EQ(metered.target(), 0.25);
  EXPECT_NEAR(metered.target_before_limits(), 0.09, 1e-5);
  ASSERT_OK_AND_ASSIGN(const RenderResult rendered, connection().render(settings, view(frame)));
  EXPECT_EQ(rendered.header.target_before_limits(), metered.target_before_limits());
  EXPECT_EQ(metered.statistics().SerializeAsString(), rendered.header.statistics().SerializeAsString());
}

TEST_P(Meter, RefusesWhatRenderRefuses) {
  WireFrame frame = natural(16, 16);
  v1::Settings settings;
  settings.mutable_exposure()->set_key(-1);
  v1::MeterResponse metered;
  EXPECT_EQ(meter(frame, settings, &metered).error_code(), grpc::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace candela::testing
