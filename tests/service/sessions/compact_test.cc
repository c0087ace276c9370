// Frames without alpha and compressed ones, and images without alpha: the same bits in fewer bytes.
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/session_run.h"
#include "tests/service/sessions/stream_client.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

class Compact : public ServiceTest {
 protected:
  static SessionRun run(SessionOptions asked, Transport transport, const Film& film) {
    asked.transport = transport;
    return run_session(Session::open({channel()}, asked), film);
  }
  // Renders the film from plain and from compressed bands.
  static void expect_same_bits(const SessionOptions& asked, const Film& film, bool opaque = true) {
    const SessionRun plain = run(asked, Transport::kGrpc, film);
    const SessionRun compact = run(asked, Transport::kZstd, film);
    ASSERT_OK(plain.status);
    ASSERT_OK(compact.status);
    ASSERT_EQ(compact.images.size(), film->size());
    EXPECT_TRUE(plain.images == compact.images);
    EXPECT_EQ(plain.exposures(), compact.exposures());
    const bool raw = asked.encoding == v1::ENCODING_RAW;
    for (const v1::ResultHeader& header : plain.headers) EXPECT_FALSE(header.alpha_left_out());
    for (const v1::ResultHeader& header : compact.headers) EXPECT_EQ(header.alpha_left_out(), raw && opaque);
  }
};
INSTANTIATE_TEST_SUITE_P(Transport, Compact, ::testing::Bool(), transport_name);

WireFrame opaque(uint32_t width, uint32_t height, v1::PixelFormat format) {
  return make_frame(width, height, format, ordinary(scenes::natural(width, height)));
}

Film film_of(uint32_t width, uint32_t height, v1::PixelFormat format) {
  auto film = std::make_shared<std::vector<WireFrame>>();
  for (uint32_t i = 0; i < 5; ++i) film->push_back(opaque(width + i % 2, height, format));
  return film;
}

// The frame without its alpha.
WireFrame narrow(const WireFrame& frame) {
  WireFrame made = frame;
  const size_t component = bytes_per_pixel(frame.desc.format) / 4;
  made.desc.format = component == 2 ? v1::PIXEL_FORMAT_RGB16F : v1::PIXEL_FORMAT_RGB32F;
  made.pixels.clear();
  for (size_t at = 0; at < frame.pixels.size(); at += 4 * component) {
    const auto* pixel = frame.pixels.data() + at;
    made.pixels.insert(made.pixels.end(), pixel, pixel + 3 * component);
  }
  return made;
}

TEST_P(Compact, CompressedFramesGiveTheSameBitsForEverySizeAndFormat) {
  constexpr v1::PixelFormat kFormats[] = {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F,
                                          v1::PIXEL_FORMAT_RGB9E5};
  constexpr v1::OutputFormat kOutputs[] = {v1::OUTPUT_FORMAT_RGBA8, v1::OUTPUT_FORMAT_RGBA16,
                                           v1::OUTPUT_FORMAT_RGBA16F};
  constexpr Size kSizes[] = {{1, 1}, {2, 7}, {63, 65}, {129, 64}, {733, 501}};
  for (const Size size : kSizes) {
    for (size_t i = 0; i < 3; ++i) {
      SCOPED_TRACE(std::to_string(size.width) + " " + std::to_string(i));
      SessionOptions asked;
      asked.settings.set_output_format(kOutputs[i]);
      expect_same_bits(asked, film_of(size.width, size.height, kFormats[i]));
    }
  }
}

TEST_P(Compact, FilesResizedImagesAndThoseWithAlphaAreTheSameBitsToo) {
  SessionOptions asked;
  asked.settings.mutable_output_size()->set_width(77);
  expect_same_bits(asked, make_film(4, 170, 90));
  asked = {};
  asked.encoding = v1::ENCODING_PNG;
  expect_same_bits(asked, make_film(4, 170, 90));
  auto film = std::make_shared<std::vector<WireFrame>>();
  for (uint32_t i = 0; i < 4; ++i) {
    film->push_back(make_frame(64, 48, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t y) -> Texel {
      return {0.3f, 0.2f, 0.1f, x == 3 && y == 5 ? 0.5f : 1.0f};
    }));
  }
  expect_same_bits({}, film, /*opaque=*/false);
}

TEST_P(Compact, FramesWithoutAlphaGiveTheBitsOfAnAlphaOfOne) {
  for (const v1::PixelFormat format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    const Film film = film_of(333, 201, format);
    auto thin = std::make_shared<std::vector<WireFrame>>();
    for (const WireFrame& frame : *film) thin->push_back(narrow(frame));
    const SessionRun expected = run({}, Transport::kGrpc, film);
    for (const Transport transport : {Transport::kGrpc, Transport::kZstd}) {
      const SessionRun got = run({}, transport, thin);
      ASSERT_OK(got.status);
      EXPECT_TRUE(got.images == expected.images);
    }
    // A single call.
    const WireFrame one = narrow(opaque(31, 17, format));
    OpenCall call(channel());
    v1::RenderRequest start = start_of(one);
    start.mutable_start()->mutable_frame()->set_may_leave_out_alpha(true);
    ASSERT_TRUE(call.write(start) && call.write(band_of(one, 0, 17)));
    call.stream->WritesDone();
    v1::RenderResponse response;
    ASSERT_TRUE(call.stream->Read(&response));
    EXPECT_TRUE(response.header().alpha_left_out());
    ASSERT_TRUE(call.stream->Read(&response));
    EXPECT_EQ(response.band().pixels().size(), 31u * 17 * 3);
    EXPECT_OK(call.finish());
  }
}

v1::RenderRequest zstd_band(const WireFrame& frame, uint32_t first, uint32_t rows) {
  v1::RowPacker packer;
  const size_t row = frame.desc.row_bytes();
  const grpc::Slice packed = packer.pack(std::span(frame.pixels).subspan(first * row, rows * row),
                                         frame.desc.width, frame.desc.format);
  v1::RenderRequest request;
  request.mutable_band()->set_first_row(first);
  request.mutable_band()->set_zstd(packed.begin(), packed.size());
  return request;
}

TEST_P(Compact, BandsThatDoNotFitOrAreDamagedAreRefused) {
  const WireFrame frame = natural(10, 8);
  const auto refused = [&](const v1::RenderRequest& band, const std::string& words) {
    OpenCall call(channel());
    ASSERT_TRUE(call.write(start_of(frame)));
    call.write(band);
    call.stream->WritesDone();
    EXPECT_REFUSED(kInvalidArgument, words, call.finish());
  };
  const WireFrame tall = natural(10, 9), wide = natural(11, 8);
  refused(zstd_band(tall, 0, 9), "holds 9 rows and the frame has only 8");
  refused(zstd_band(wide, 0, 7), "not a whole number of rows of 80 bytes");
  refused(zstd_band(frame, 1, 7), "row 0 is next");
  refused(zstd_band(frame, 0, 7), "7 of 8 rows");
  v1::RenderRequest damaged = zstd_band(frame, 0, 8);
  damaged.mutable_band()->mutable_zstd()->resize(damaged.band().zstd().size() / 2);
  refused(damaged, "not one whole frame of zstd");
  damaged = zstd_band(frame, 0, 8);
  damaged.mutable_band()->mutable_zstd()->at(30) ^= 0x55;
  // Other pixels, or none: nobody is hurt.
  OpenCall call(channel());
  call.write(start_of(frame));
  call.write(damaged);
  call.stream->WritesDone();
  const grpc::StatusCode code = call.finish().error_code();
  EXPECT_TRUE(code == grpc::OK || code == grpc::INVALID_ARGUMENT) << code;
  damaged.mutable_band()->set_zstd("no frame of zstd at all");
  refused(damaged, "not one whole frame of zstd");
}

TEST_P(Compact, FramesWithoutAlphaAreNotTakenFromMemory) {
  v1::RenderRequest start = start_of(narrow(opaque(10, 8, v1::PIXEL_FORMAT_RGBA16F)));
  start.mutable_start()->mutable_frame()->mutable_memory()->set_ticket(std::string(16, 't'));
  start.mutable_start()->mutable_frame()->mutable_memory()->set_pixels_offset(0);
  OpenCall call(channel());
  call.write(start);
  EXPECT_REFUSED(kInvalidArgument, "pixels in memory have an alpha", call.finish());
}

}  // namespace
}  // namespace candela::testing
