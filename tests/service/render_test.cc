// Render calls that succeed.
#include <grpcpp/support/byte_buffer.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_join.h"
#include "tests/service/service_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

class Render : public ServiceTest {};
INSTANTIATE_TEST_SUITE_P(Transport, Render, ::testing::Bool(), transport_name);

// Uses the contract as any client would, by the generated classes alone. Sends a row stride if `padding` > 0.
struct Plain {
  grpc::Status status;
  v1::ResultHeader header;
  std::string pixels;
};
Plain render_plainly(const std::shared_ptr<grpc::Channel>& channel, const WireFrame& frame,
                     uint32_t rows_a_band, const v1::Settings& settings = {}, uint32_t padding = 0) {
  Plain plain;
  grpc::ClientContext context;
  const auto stub = v1::RenderService::NewStub(channel);
  const auto stream = stub->Render(&context);
  v1::RenderRequest start = start_of(frame);
  *start.mutable_start()->mutable_settings() = settings;
  const uint64_t row_bytes = frame.desc.row_bytes();
  if (padding > 0)
    start.mutable_start()->mutable_frame()->set_row_stride_bytes(static_cast<uint32_t>(row_bytes + padding));
  stream->Write(start);
  for (uint32_t y = 0; y < frame.desc.height; y += rows_a_band) {
    v1::RenderRequest request;
    request.mutable_band()->set_first_row(y);
    for (uint32_t row = y; row < std::min(frame.desc.height, y + rows_a_band); ++row) {
      request.mutable_band()->mutable_pixels()->append(
          reinterpret_cast<const char*>(frame.pixels.data() + row * row_bytes), row_bytes);
      request.mutable_band()->mutable_pixels()->append(padding, '\xee');
    }
    stream->Write(request);
  }
  stream->WritesDone();
  v1::RenderResponse response;
  if (stream->Read(&response)) {
    EXPECT_TRUE(response.has_header());
    plain.header = response.header();
  }
  uint64_t rows = 0;
  while (stream->Read(&response)) {
    EXPECT_TRUE(response.has_band());
    EXPECT_EQ(response.band().first_row(), rows);
    EXPECT_LE(response.band().pixels().size(), v1::kMaxBandBytes);
    rows += response.band().pixels().size() /
            (uint64_t{plain.header.width()} * (plain.header.format() == v1::OUTPUT_FORMAT_RGBA8 ? 4 : 8));
    plain.pixels += response.band().pixels();
  }
  plain.status = stream->Finish();
  return plain;
}

std::string text(std::span<const std::byte> bytes) {
  return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

TEST_P(Render, OddSizesEvenSizesAndManyBandsComeBackWhole) {
  struct Size {
    uint32_t width;
    uint32_t height;
  };
  // Some widths are multiples of the texel group and some are not. The last two need several bands each way.
  for (const Size& size :
       {Size{1, 1}, Size{1, 7}, Size{3, 5}, Size{64, 64}, Size{257, 31}, Size{1024, 700}, Size{1023, 700}}) {
    const WireFrame frame = natural(size.width, size.height);
    ASSERT_OK_AND_ASSIGN(const RenderResult ours, connection().render({}, view(frame, 77)));
    EXPECT_EQ(ours.header.sequence(), 77u);
    EXPECT_EQ(ours.bytes, uint64_t{size.width} * size.height * 4);
    const Plain plain = render_plainly(channel(), frame, 13);
    ASSERT_OK(plain.status);
    EXPECT_EQ(text(ours.pixels()), plain.pixels) << size.width << "x" << size.height;
  }
}

TEST_P(Render, EveryFormatInAndOut) {
  for (v1::PixelFormat in : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
    const WireFrame frame = natural(37, 21, in);
    for (v1::OutputFormat out :
         {v1::OUTPUT_FORMAT_RGBA8, v1::OUTPUT_FORMAT_RGBA16, v1::OUTPUT_FORMAT_RGBA16F}) {
      v1::Settings settings;
      settings.set_output_format(out);
      ASSERT_OK_AND_ASSIGN(const RenderResult result, connection().render(settings, view(frame)));
      EXPECT_EQ(result.header.format(), out);
      EXPECT_EQ(result.bytes, 37u * 21 * (out == v1::OUTPUT_FORMAT_RGBA8 ? 4 : 8));
    }
  }
}

TEST_P(Render, AVerifiedFrameComesWithItsErrorAndItsMap) {
  // Several bands of image and of map, and a width that is not a multiple of the texel group.
  const WireFrame frame = natural(1023, 1100, v1::PIXEL_FORMAT_RGBA32F);
  FrameView plain = view(frame), verified = view(frame), mapped = view(frame);
  verified.verify = mapped.verify = mapped.error_map = true;
  ASSERT_OK_AND_ASSIGN(const RenderResult a, connection().render({}, plain));
  ASSERT_OK_AND_ASSIGN(const RenderResult b, connection().render({}, verified));
  ASSERT_OK_AND_ASSIGN(const RenderResult c, connection().render({}, mapped));
  EXPECT_FALSE(a.header.has_verify());
  EXPECT_TRUE(a.error_map.empty());
  EXPECT_TRUE(b.error_map.empty());
  EXPECT_EQ(text(a.pixels()), text(b.pixels()));
  EXPECT_EQ(text(a.pixels()), text(c.pixels()));
  EXPECT_EQ(b.header.verify().SerializeAsString(), c.header.verify().SerializeAsString());
  const v1::Verification& error = c.header.verify();
  EXPECT_GT(error.max_error_codes(), 0);
  EXPECT_LE(error.max_error_codes(), 0.5);
  EXPECT_LE(error.p999_error_codes(), 0.05);
  EXPECT_GT(c.header.verify_unrounded().max_error_codes(), error.max_error_codes());
  EXPECT_EQ(c.header.stages(c.header.stages_size() - 1).name(), "verify");
  ASSERT_EQ(c.error_map.size(), 1023u * 1100u);
  // Positive halves have the same order as their bits.
  const uint16_t worst = *std::max_element(c.error_map.begin(), c.error_map.end());
  EXPECT_EQ(c.error_map[size_t{error.worst_y()} * 1023 + error.worst_x()], worst);
}

TEST_P(Render, VerificationBeyondTheBudgetIsRefusedBeforeAPixelIsRead) {
  // 256 MiB are enough for the frame but not for its verification.
  OpenCall call(channel());
  v1::RenderRequest start;
  start.mutable_start()->mutable_frame()->set_width(2800);
  start.mutable_start()->mutable_frame()->set_height(2800);
  start.mutable_start()->mutable_frame()->set_format(v1::PIXEL_FORMAT_RGBA16F);
  start.mutable_start()->set_verify(true);
  call.write(start);
  EXPECT_REFUSED(kResourceExhausted, "the memory budget is 268435456", call.finish());
}

TEST_P(Render, RowPaddingChangesNothing) {
  const WireFrame frame = natural(31, 17);
  const Plain tight = render_plainly(channel(), frame, 4);
  const Plain padded = render_plainly(channel(), frame, 4, {}, 12);
  ASSERT_TRUE(tight.status.ok() && padded.status.ok()) << padded.status.error_message();
  EXPECT_EQ(tight.pixels, padded.pixels);
}

TEST_P(Render, AnImageOfAnotherSizeComesBackWhole) {
  const WireFrame frame = natural(1201, 900);
  v1::Settings settings;
  for (const uint32_t longer : {64u, 1203u}) {  // the second needs several bands
    settings.mutable_output_size()->set_max_side(longer);
    if (longer > 1201) {
      settings.mutable_output_size()->clear_max_side();
      settings.mutable_output_size()->set_width(longer);
    }
    const Plain plain = render_plainly(channel(), frame, 13, settings);
    ASSERT_OK(plain.status);
    EXPECT_EQ(plain.header.width(), longer);
    EXPECT_EQ(plain.header.height(), longer == 64 ? 48u : 901u);
    EXPECT_EQ(plain.pixels.size(), uint64_t{plain.header.width()} * plain.header.height() * 4);
  }
}

TEST_P(Render, AnImageBeyondTheLimitsIsRefusedBeforeAPixelIsRead) {
  const auto refused = [](uint32_t width) {
    OpenCall call(channel());
    v1::RenderRequest start = start_of(flat(8, 8, {1, 1, 1, 1}));
    start.mutable_start()->mutable_settings()->mutable_output_size()->set_width(width);
    call.write(start);
    return call.finish();
  };
  EXPECT_REFUSED(kResourceExhausted, "at most 16384 a side", refused(16385));
  EXPECT_REFUSED(kResourceExhausted, "the memory budget is 268435456", refused(4096));
}

TEST_P(Render, TheHeaderSaysWhatWasDone) {
  v1::Settings settings = at_ev(1);
  settings.set_prescale(2);
  ASSERT_OK_AND_ASSIGN(const RenderResult result,
                       connection().render(settings, view(flat(8, 8, {0.5f, 0.5f, 0.5f, 1.0f}), 3)));
  const v1::ResultHeader& header = result.header;
  EXPECT_EQ(header.sequence(), 3u);
  EXPECT_EQ(header.width(), 8u);
  EXPECT_EQ(header.exposure(), 2.0);
  EXPECT_EQ(header.prescale(), 2.0);
  EXPECT_NEAR(header.statistics().max_luminance(), 0.5, 1e-3);
  EXPECT_NEAR(header.statistics().mean_log2_luminance(), -1, 1e-3);
  EXPECT_EQ(header.tier(), "standard");
  EXPECT_EQ(header.device(), server().device_name());
  EXPECT_GT(header.plan_size(), 0);
  ASSERT_GT(header.stages_size(), 1);
  EXPECT_EQ(header.stages(0).name(), "queue");
}

TEST_P(Render, APromiseChoosesTheTier) {
  const WireFrame frame = natural(200, 100);
  v1::Settings settings;
  settings.set_max_error_codes(0.5);
  ASSERT_OK_AND_ASSIGN(const RenderResult exact, connection().render(settings, view(frame)));
  EXPECT_EQ(exact.header.tier(), "standard");
  EXPECT_TRUE(says(exact.header.tier_reason(), "keeps max_error_codes 0.5"));
  // Without bloom, draft is accurate enough.
  settings.mutable_bloom()->set_intensity(0);
  ASSERT_OK_AND_ASSIGN(const RenderResult plain, connection().render(settings, view(frame)));
  EXPECT_EQ(plain.header.tier(), "draft");
  EXPECT_GT(plain.header.error_bound_codes(), 0);
  EXPECT_LE(plain.header.error_bound_codes(), 0.5);
  EXPECT_TRUE(says(plain.header.tier_reason(), "draft is within"));

  settings.set_tier("draft");
  EXPECT_TRUE(absl::IsInvalidArgument(connection().render(settings, view(frame)).status()));
}

TEST_P(Render, TheNewSettingsArrive) {
  const WireFrame frame = natural(67, 35);
  v1::Settings settings;
  v1::Metering& metering = *settings.mutable_exposure()->mutable_metering();
  metering.set_weights(v1::Metering::WEIGHTS_SPOT);
  metering.mutable_spot()->set_x1(30);
  metering.mutable_spot()->set_y1(1000);
  settings.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
  settings.set_dither(true);
  settings.set_input_primaries(v1::PRIMARIES_REC2020);
  FrameView asked = view(frame);
  asked.previous.emplace();
  asked.previous->set_exposure(2);
  asked.previous->set_elapsed_seconds(0.25);
  ASSERT_OK_AND_ASSIGN(const RenderResult result, connection().render(settings, asked));
  const std::string plan = absl::StrJoin(result.header.plan(), "\n");
  for (const char* words : {"meter in x 0 .. 30, y 0 .. 1000", "gaussian bloom at 17x9", "rgba8 dithered"}) {
    EXPECT_TRUE(says(plan, words));
  }
  const double speed = result.header.target() > 2 ? 3.0 : 1.0;
  const double left = std::exp(-0.25 * speed);
  EXPECT_NEAR(std::log2(result.header.exposure()),
              (1 - left) * std::log2(result.header.target()) + left * std::log2(2.0), 1e-12);

  asked.previous->set_elapsed_seconds(-1);
  EXPECT_TRUE(absl::IsInvalidArgument(connection().render(settings, asked).status()));
  asked.previous.reset();
  metering.mutable_spot()->set_x0(67);
  metering.mutable_spot()->set_x1(70);
  const absl::Status beside = connection().render(settings, asked).status();
  EXPECT_TRUE(says(beside.message(), "beside the frame of 67x35"));
}

TEST_P(Render, ABadPixelUnderRejectIsRefusedByName) {
  WireFrame frame = flat(8, 8, {1, 1, 1, 1});
  const uint16_t infinity = 0x7c00;
  std::memcpy(frame.pixels.data() + 8 * (8 * 2 + 5), &infinity, sizeof(infinity));
  v1::Settings settings;
  settings.set_bad_values(v1::BAD_VALUES_REJECT);
  EXPECT_REFUSED(kInvalidArgument, "", connection().render(settings, view(frame)));
}

TEST_P(Render, AHundredCallsLeaveNothingInUseAndHitThePool) {
  const WireFrame frame = natural(64, 48);
  ASSERT_OK(connection().render({}, view(frame)));
  ASSERT_TRUE(wait_until_idle(connection()));
  const v1::PoolInfo before = pool();
  for (uint64_t i = 0; i < 100; ++i) {
    ASSERT_OK_AND_ASSIGN(const RenderResult result, connection().render({}, view(frame, i)));
    EXPECT_EQ(result.header.sequence(), i);
    // A frame that begins before the previous one's bands have been sent would rightly take other textures.
    ASSERT_TRUE(wait_until_idle(connection()));
  }
  const v1::PoolInfo after = pool();
  EXPECT_EQ(after.bytes_in_use(), 0u);
  EXPECT_GE(after.hits(), before.hits() + 100);
  EXPECT_EQ(after.misses(), before.misses());
}

// As many as the server takes: each has room for its next call as soon as it has its answer.
TEST_P(Render, ManyClientsAtOnceEachGetTheirOwnImage) {
  std::vector<std::thread> clients;
  for (uint32_t c = 0; c < kMaxCalls; ++c) {
    clients.emplace_back([c] {
      const WireFrame frame = natural(40 + c, 30);
      const Connection own = connection();
      std::string first;
      for (int i = 0; i < 10; ++i) {
        ASSERT_OK_AND_ASSIGN(const RenderResult result, own.render({}, view(frame, c)));
        ASSERT_EQ(result.header.width(), 40 + c);
        if (i == 0) first = text(result.pixels());
        ASSERT_EQ(text(result.pixels()), first);
      }
    });
  }
  for (std::thread& client : clients) client.join();
}

}  // namespace
}  // namespace candela::testing
