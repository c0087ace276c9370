// Single calls: images, metering, executors, hard cases, and frames that are refused.
#include <grpcpp/support/byte_buffer.h>
#include <gtest/gtest.h>
#include <half.h>
#include <sys/stat.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <numeric>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "client/call/raw_call.h"
#include "client/call/retry_schedule.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/files.h"
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

// Frames and bands that the server refuses.

class BadFrames : public ServiceTest {
 protected:
  // Sends the requests, half-closes and returns the call's status.
  static grpc::Status send(const std::vector<v1::RenderRequest>& requests) {
    OpenCall call(channel());
    for (const v1::RenderRequest& request : requests) {
      if (!call.write(request)) break;
    }
    call.stream->WritesDone();
    return call.finish();
  }
  static void expect_refused(const std::vector<v1::RenderRequest>& requests, const std::string& words) {
    EXPECT_REFUSED(kInvalidArgument, words, send(requests));
  }

  const WireFrame frame_ = natural(10, 8);
};
INSTANTIATE_TEST_SUITE_P(Transport, BadFrames, ::testing::Bool(), transport_name);

TEST_P(BadFrames, BandsThatDoNotTileTheFrameAreRefused) {
  const v1::RenderRequest start = start_of(frame_);
  const auto band = [this](uint32_t row, uint32_t rows) { return band_of(frame_, row, rows); };
  expect_refused({start}, "0 of 8 rows");
  expect_refused({start, band(0, 7)}, "7 of 8 rows");
  expect_refused({start, band(0, 4), band(3, 4)}, "row 4 is next");
  expect_refused({start, band(0, 3), band(4, 4)}, "row 3 is next");
  expect_refused({start, band(4, 4), band(0, 4)}, "row 0 is next");
  expect_refused({start, band(0, 8), band(0, 1)}, "only 8");
  v1::RenderRequest part = band(0, 2);
  part.mutable_band()->mutable_pixels()->pop_back();
  expect_refused({start, part}, "whole number of rows");
  part.mutable_band()->clear_pixels();
  expect_refused({start, part}, "no pixels");
  v1::RenderRequest large = band(0, 1);
  large.mutable_band()->mutable_pixels()->resize(v1::kMaxBandBytes + 80, 'x');
  expect_refused({start, large}, "at most 2097152");
}

TEST_P(BadFrames, MessagesOutOfPlaceAreRefused) {
  const v1::RenderRequest start = start_of(frame_);
  expect_refused({}, "before its start");
  expect_refused({band_of(frame_, 0, 8)}, "no `start`");
  expect_refused({v1::RenderRequest()}, "no `start`");
  expect_refused({start, start}, "no band");
  expect_refused({start, v1::RenderRequest()}, "no band");
}

TEST_P(BadFrames, GarbageIsRefusedWherever) {
  for (bool after_start : {false, true}) {
    for (const std::string& bytes : {std::string("\xff\xff\xff\xff"), std::string(1000, '\x12'),
                                     std::string(10, '\0'), std::string("\x12\x05\x12\xff\xff\xff\x7f")}) {
      RawCall call(channel(), "/candela.v1.RenderService/Render", absl::Now() + absl::Seconds(20));
      const grpc::Slice start(start_of(frame_).SerializeAsString());
      if (after_start) call.write(grpc::ByteBuffer(&start, 1));
      const grpc::Slice slice(bytes);
      call.write(grpc::ByteBuffer(&slice, 1));
      grpc::ByteBuffer answer;
      EXPECT_FALSE(call.read(answer));
      EXPECT_EQ(call.finish().error_code(), grpc::INVALID_ARGUMENT);
    }
  }
}

TEST_P(BadFrames, AMessageOverTheLimitIsRefused) {
  v1::RenderRequest huge = band_of(frame_, 0, 1);
  huge.mutable_band()->mutable_pixels()->resize(v1::kMaxMessageBytes + 1, 'x');
  EXPECT_EQ(send({start_of(frame_), huge}).error_code(), grpc::RESOURCE_EXHAUSTED);
}

TEST_P(BadFrames, AFrameBeyondTheLimitsIsRefusedByItsHeaderBeforeAnyMemory) {
  ASSERT_TRUE(wait_until_idle(connection()));
  const v1::PoolInfo before = pool();
  struct Size {
    uint32_t width;
    uint32_t height;
    grpc::StatusCode code;
  };
  for (const Size& size : {Size{0, 8, grpc::INVALID_ARGUMENT}, Size{8, 0, grpc::INVALID_ARGUMENT},
                           Size{16385, 1, grpc::RESOURCE_EXHAUSTED}, Size{1, 16385, grpc::RESOURCE_EXHAUSTED},
                           Size{4096, 2049, grpc::RESOURCE_EXHAUSTED},  // a row over the suite's 64 MiB
                           Size{0xffffffff, 0xffffffff, grpc::RESOURCE_EXHAUSTED},
                           Size{65536, 65536, grpc::RESOURCE_EXHAUSTED}}) {
    v1::RenderRequest start = start_of(frame_);
    start.mutable_start()->mutable_frame()->set_width(size.width);
    start.mutable_start()->mutable_frame()->set_height(size.height);
    // The server answers the header alone, without a band or a half-close.
    RawCall call(channel(), "/candela.v1.RenderService/Render", absl::Now() + absl::Seconds(20));
    const grpc::Slice bytes(start.SerializeAsString());
    call.write(grpc::ByteBuffer(&bytes, 1));
    grpc::ByteBuffer answer;
    EXPECT_FALSE(call.read(answer));
    EXPECT_EQ(call.finish().error_code(), size.code) << size.width << "x" << size.height;
  }
  const v1::PoolInfo after = pool();
  EXPECT_EQ(after.SerializeAsString(), before.SerializeAsString());  // the pool was not touched
}

// The frame has 56 MB in 27 bands. A client must not send all of a frame that was refused by its header.
TEST_P(BadFrames, TheClientHearsARefusalBeforeItHasSentTheFrame) {
  const FrameDesc desc{16384, 430, v1::PIXEL_FORMAT_RGBA16F};
  const std::vector<std::byte> pixels(desc.bytes());
  v1::Settings settings;
  settings.set_tier("splendid");
  EXPECT_REFUSED(kInvalidArgument, "splendid",
                 connection().render(settings, {desc.width, desc.height, v1::PIXEL_FORMAT_RGBA16F, pixels}));
}

TEST_P(BadFrames, UnknownEnumsAndNonFiniteSettingsAreRefusedByName) {
  v1::RenderRequest start = start_of(frame_);
  start.mutable_start()->mutable_settings()->set_curve(static_cast<v1::ToneCurve>(99));
  expect_refused({start}, "curve is 99");
  start = start_of(frame_);
  start.mutable_start()->mutable_settings()->set_prescale(std::numeric_limits<double>::quiet_NaN());
  expect_refused({start}, "prescale");
  start = start_of(frame_);
  start.mutable_start()->mutable_settings()->set_tier(std::string(60000, 'x'));
  EXPECT_EQ(send({start}).error_code(), grpc::INVALID_ARGUMENT);  // and its message still fits the headers
}

TEST_P(BadFrames, AFrameThatTheMemoryBudgetCannotHoldNowIsToldToTryAgain) {
  WireFrame large;
  large.desc = {4096, 1000, v1::PIXEL_FORMAT_RGBA32F};  // within 64 MiB; five at once are not within 256
  std::vector<std::unique_ptr<RawCall>> held;
  for (int i = 0; i < 6; ++i) {
    auto call = std::make_unique<RawCall>(channel(), "/candela.v1.RenderService/Render",
                                          absl::Now() + absl::Seconds(20));
    const grpc::Slice bytes(start_of(large).SerializeAsString());
    call->write(grpc::ByteBuffer(&bytes, 1));
    v1::RenderRequest row;
    row.mutable_band()->set_pixels(std::string(large.desc.row_bytes(), '\0'));
    const grpc::Slice pixels(row.SerializeAsString());
    call->write(grpc::ByteBuffer(&pixels, 1));
    absl::SleepFor(absl::Milliseconds(50));
    held.push_back(std::move(call));
  }
  EXPECT_LE(pool().bytes_in_use(), uint64_t{256} << 20);
  grpc::ByteBuffer answer;
  EXPECT_FALSE(held.back()->read(answer));
  const grpc::Status refusal = held.back()->finish();
  EXPECT_EQ(refusal.error_code(), grpc::UNAVAILABLE) << refusal.error_message();
  EXPECT_GT(retry_delay(refusal), absl::ZeroDuration());
  held.clear();
  EXPECT_TRUE(wait_until_idle(connection()));
}

// The hard cases of docs/pipeline.md section 6 over the wire, in every tier. Each gives a finite picture
// within its error.

class HardCases : public ServiceTest {};
INSTANTIATE_TEST_SUITE_P(Transport, HardCases, ::testing::Bool(), transport_name);

bool finite(const RenderResult& result) {
  for (size_t at = 0; at < result.bytes; at += 2) {
    uint16_t bits;
    std::memcpy(&bits, result.data.get() + at, sizeof bits);
    if (!std::isfinite(imath_half_to_float(bits))) return false;
  }
  return true;
}

// A case as a picture of half floats, verified.
absl::StatusOr<RenderResult> render_case(const Connection& connection, const HardCase& hard, uint32_t width,
                                         uint32_t height, v1::Settings settings) {
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  const WireFrame frame = make_frame(width, height, v1::PIXEL_FORMAT_RGBA32F, hard.texel);
  FrameView asked = view(frame);
  asked.verify = true;
  return connection.render(settings, asked);
}

// The bound of a tier that leaves bloom's finest level out.
constexpr double kNoBound = 255;

TEST_P(HardCases, GiveAFinitePictureWithinThePublishedErrorInEveryTier) {
  ASSERT_OK_AND_ASSIGN(const v1::GetServerInfoResponse info, connection().server_info());
  for (const v1::Tier& tier : info.tiers()) {
    for (const auto& [width, height] : {std::pair{1u, 1u}, {1u, 7u}, {3u, 5u}, {16384u, 1u}, {67u, 35u}}) {
      for (const HardCase& hard : hard_cases(width, height)) {
        for (const bool bloom : {true, false}) {
          v1::Settings settings;
          settings.set_tier(tier.name());
          if (!bloom) settings.mutable_bloom()->set_intensity(0);
          const absl::StatusOr<RenderResult> result =
              render_case(connection(), hard, width, height, settings);
          const std::string what =
              tier.name() + " " + hard.name + " " + std::to_string(width) + (bloom ? "" : " no bloom");
          ASSERT_OK(result) << what;
          EXPECT_TRUE(finite(*result)) << what;
          EXPECT_TRUE(std::isfinite(result->header.exposure())) << what;
          EXPECT_LE(result->header.verify().meter_error_ev(), 2e-5) << what;
          const double published = bloom ? tier.max_error_codes_with_bloom() : tier.max_error_codes();
          EXPECT_EQ(published == kNoBound, bloom && tier.name() == "draft") << what;
          // Half floats are display-linear, so no tier's transfer adds an error.
          EXPECT_LE(result->header.verify().max_error_codes(), published == kNoBound ? kNoBound : 4e-4)
              << what;
        }
      }
    }
  }
}

// What verification itself cannot tell apart: its images are floats.
constexpr double kFloatCodes = 5e-5;

TEST_P(HardCases, AreWithinTheBoundThatTheAnswerNames) {
  std::set<std::string> taken;
  for (const double codes : {0.05, 1.0}) {
    for (const HardCase& hard : hard_cases(67, 35)) {
      for (const bool bloom : {true, false}) {
        v1::Settings settings;
        settings.set_max_error_codes(codes);
        if (!bloom) settings.mutable_bloom()->set_intensity(0);
        const absl::StatusOr<RenderResult> result = render_case(connection(), hard, 67, 35, settings);
        const std::string what =
            hard.name + " within " + std::to_string(codes) + (bloom ? "" : " without bloom");
        ASSERT_OK(result) << what;
        const v1::ResultHeader& header = result->header;
        ASSERT_TRUE(header.has_error_bound_codes()) << what;
        EXPECT_LE(header.error_bound_codes(), codes) << what;
        EXPECT_LE(header.verify().max_error_codes(), header.error_bound_codes() + kFloatCodes)
            << what << ": " << header.tier_reason();
        taken.insert(header.tier());
      }
    }
  }
  EXPECT_TRUE(taken.contains("draft") && taken.contains("standard")) << "the cases are too easy or too hard";
}

// The luminance jumps from black to 65504 between two frames that are no time, a moment or a long time apart.
TEST_P(HardCases, AStepInLuminanceAdaptsToAFiniteExposure) {
  const WireFrame bright = flat(67, 35, {65504, 65504, 65504, 1});
  ASSERT_OK_AND_ASSIGN(const RenderResult dark, connection().render({}, view(flat(67, 35, {0, 0, 0, 1}))));
  EXPECT_EQ(dark.header.exposure(), 64.0);
  for (double elapsed : {0.0, 1e-9, 1.0 / 24, 1e9}) {
    FrameView asked = view(bright);
    asked.previous.emplace();
    asked.previous->set_exposure(dark.header.exposure());
    asked.previous->set_elapsed_seconds(elapsed);
    ASSERT_OK_AND_ASSIGN(const RenderResult result, connection().render({}, asked));
    const double target = 1.0 / 64;  // the smallest allowed by default
    EXPECT_EQ(result.header.target(), target);
    EXPECT_NEAR(std::log2(result.header.exposure()), -6 + 12 * std::exp(-elapsed), 1e-12) << elapsed;
  }
}

// Meter reports the same as Render, without an image.

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

// A session that moves between a server with the device's passes and one with the host's.

class PassesMoved : public ::testing::Test {
 protected:
  void SetUp() override {
    Config config = test_config();
    config.resume_keys = folder_.path("keys");
    write_file(config.resume_keys, "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n");
    ASSERT_EQ(chmod(config.resume_keys.c_str(), S_IRUSR), 0);
    config.executor = ExecutorKind::kDevice;
    device_ = start_server(config);
    config.executor = ExecutorKind::kHost;
    absl::StatusOr<std::unique_ptr<Server>> host = Server::start(config, real_clock(), alarm_timers());
    if (absl::IsFailedPrecondition(host.status())) GTEST_SKIP() << host.status();
    ASSERT_OK(host);
    host_ = *std::move(host);
  }

  static v1::DeviceInfo device_of(Server& server) {
    return Connection(server.in_process_channel())
        .server_info(absl::Now() + absl::Seconds(10))
        .value()
        .device();
  }

  TemporaryFolder folder_;
  std::unique_ptr<Server> device_;
  std::unique_ptr<Server> host_;
};

std::vector<WireFrame> brightening() {
  std::vector<WireFrame> frames;
  for (uint32_t i = 0; i < 6; ++i) {
    const float light = std::exp2(static_cast<float>(i) - 2.0f);
    frames.push_back(make_frame(97, 41, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) {
      Texel t = scenes::natural(97, 41)(x, y);
      for (size_t k = 0; k < 3; ++k) t[k] *= light;
      return t;
    }));
  }
  return frames;
}

// The answers of the frames from `first` on.
std::vector<StreamResult> go_on(Server& server, v1::StreamOpen open, const std::vector<WireFrame>& frames,
                                size_t first) {
  StreamClient client(server.in_process_channel());
  EXPECT_TRUE(client.open(open));
  std::thread writer([&] {
    for (size_t i = first; i < frames.size(); ++i) client.send(frames[i], i, film_time_ns(i));
    client.half_close();
  });
  std::vector<StreamResult> results = client.read_all();
  writer.join();
  EXPECT_OK(client.finish());
  return results;
}

TEST_F(PassesMoved, KeepsItsExposuresAndItsPixelsWithinACode) {
  EXPECT_EQ(device_of(*device_).passes(), "device");
  EXPECT_EQ(device_of(*host_).passes(), "host");
  EXPECT_NE(device_of(*device_).bits(), device_of(*host_).bits());
  const std::vector<WireFrame> frames = brightening();
  v1::StreamOpen open;
  open.set_session("moving");
  for (Server* const first : {device_.get(), host_.get()}) {
    Server& second = first == device_.get() ? *host_ : *device_;
    open.set_resume_token("");
    const std::vector<StreamResult> whole = go_on(*first, open, frames, 0);
    ASSERT_EQ(whole.size(), frames.size());
    open.set_resume_token(whole[2].token());
    const std::vector<StreamResult> rest = go_on(second, open, frames, 3);
    ASSERT_EQ(rest.size(), frames.size() - 3);
    for (size_t i = 0; i < rest.size(); ++i) {
      const StreamResult& there = whole[3 + i];
      EXPECT_EQ(std::bit_cast<uint64_t>(rest[i].header.exposure()),
                std::bit_cast<uint64_t>(there.header.exposure()));
      ASSERT_EQ(rest[i].pixels.size(), there.pixels.size());
      for (size_t k = 0; k < there.pixels.size(); ++k) {
        ASSERT_LE(std::abs(static_cast<uint8_t>(rest[i].pixels[k]) - static_cast<uint8_t>(there.pixels[k])),
                  1);
      }
    }
  }
}

}  // namespace
}  // namespace candela::testing
