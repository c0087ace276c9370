// Frames and bands that the server refuses.
#include <limits>
#include <string>
#include <vector>

#include "absl/time/clock.h"
#include "client/call/raw_call.h"
#include "client/call/retry_schedule.h"
#include "tests/service/service_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

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

}  // namespace
}  // namespace candela::testing
