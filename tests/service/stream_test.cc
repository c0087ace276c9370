// Sessions as render.proto promises them: order, exposure over time, changes, look-ahead, encodings and
// resuming.
#include <png.h>

#include <cmath>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

class Stream : public ServiceTest {
 protected:
  // Every size and format, alternately brighter and darker.
  static std::vector<WireFrame> film(size_t count) {
    std::vector<WireFrame> frames;
    for (size_t i = 0; i < count; ++i) {
      const auto width = static_cast<uint32_t>(37 + 61 * (i % 3));
      const auto height = static_cast<uint32_t>(29 + 40 * (i % 2));
      frames.push_back(natural(width, height));
    }
    return frames;
  }
  static WireFrame grey(float value, uint32_t width = 64, uint32_t height = 48) {
    return flat(width, height, {value, value, value, 1.0f});
  }
  // Frames of one picture. Halfway, its light grows by a factor of 2^12.
  static std::vector<WireFrame> step(size_t count) {
    std::vector<WireFrame> frames;
    for (size_t i = 0; i < count; ++i) frames.push_back(grey(i < count / 2 ? 0.01f : 40.96f));
    return frames;
  }
};
INSTANTIATE_TEST_SUITE_P(Transport, Stream, ::testing::Bool(), transport_name);

TEST_P(Stream, ResultsComeInOrderWhateverTheSizes) {
  const std::vector<WireFrame> frames = film(12);
  const std::vector<StreamResult> results = stream_all(channel(), open_of("order"), frames);
  ASSERT_EQ(results.size(), frames.size());
  for (size_t i = 0; i < results.size(); ++i) {
    EXPECT_EQ(results[i].header.sequence(), i);
    EXPECT_EQ(results[i].header.width(), frames[i].desc.width);
    EXPECT_EQ(results[i].header.height(), frames[i].desc.height);
    EXPECT_FALSE(results[i].token().empty());
    EXPECT_LE(results[i].token().size(), v1::kMaxTokenBytes);
  }
}

TEST_P(Stream, ExposureFollowsTheRecursionAndEachImageIsWhatRenderMakesOfIt) {
  const std::vector<WireFrame> frames = step(10);
  const std::vector<StreamResult> results = stream_all(channel(), open_of("recursion"), frames);
  ASSERT_EQ(results.size(), frames.size());
  for (size_t i = 0; i < results.size(); ++i) {
    FrameView frame = view(frames[i], i);
    if (i > 0) {
      EXPECT_EQ(results[i].header.exposure_before(), results[i - 1].header.exposure());
      frame.previous = v1::ExposureState();
      frame.previous->set_exposure(results[i - 1].header.exposure());
      frame.previous->set_elapsed_seconds(static_cast<double>(film_time_ns(i) - film_time_ns(i - 1)) * 1e-9);
    }
    ASSERT_OK_AND_ASSIGN(const RenderResult alone, connection().render({}, frame));
    EXPECT_EQ(results[i].header.exposure(), alone.header.exposure());
    EXPECT_EQ(results[i].header.target(), alone.header.target());
    EXPECT_EQ(0, std::memcmp(results[i].pixels.data(), alone.data.get(), alone.bytes)) << "frame " << i;
  }
  EXPECT_LT(results[9].header.exposure(), results[4].header.exposure());
  EXPECT_GT(results[9].header.exposure(), results[9].header.target()) << "it takes its time";
}

// Opaque frames, transparent ones and frames of nothing in turn: each is what Render makes of it, and a frame
// of nothing keeps the exposure before it.
TEST_P(Stream, FramesMayBeOpaqueOrTransparent) {
  const auto frame = [](size_t kind) {
    return make_frame(64, 48, v1::PIXEL_FORMAT_RGBA16F, [kind](uint32_t x, uint32_t y) -> Texel {
      const float a = kind == 0 || x < 32 ? 1.0f : kind == 1 ? static_cast<float>(y) / 64 : 0.0f;
      return kind == 2 ? Texel{0, 0, 0, 0} : Texel{a, 0.5f * a, 0.25f * a, a};
    });
  };
  std::vector<WireFrame> frames;
  for (size_t i = 0; i < 9; ++i) frames.push_back(frame(2 * i % 3));
  v1::StreamOpen open = open_of("alpha");
  open.mutable_settings()->set_alpha(v1::ALPHA_STRAIGHT);
  const std::vector<StreamResult> results = stream_all(channel(), open, frames);
  ASSERT_EQ(results.size(), frames.size());
  for (size_t i = 0; i < results.size(); ++i) {
    FrameView view_of_frame = view(frames[i], i);
    if (i > 0) {
      view_of_frame.previous = v1::ExposureState();
      view_of_frame.previous->set_exposure(results[i - 1].header.exposure());
      view_of_frame.previous->set_elapsed_seconds(static_cast<double>(film_time_ns(i) - film_time_ns(i - 1)) *
                                                  1e-9);
    }
    ASSERT_OK_AND_ASSIGN(const RenderResult alone, connection().render(open.settings(), view_of_frame));
    EXPECT_EQ(results[i].header.exposure(), alone.header.exposure());
    EXPECT_EQ(0, std::memcmp(results[i].pixels.data(), alone.data.get(), alone.bytes)) << "frame " << i;
    const bool nothing = results[i].header.statistics().absent_pixels() == 64u * 48u;
    if (i == 0 || !nothing) continue;
    EXPECT_EQ(results[i].header.exposure(), results[i - 1].header.exposure());
  }
}

TEST_P(Stream, ACutTakesItsTargetAndARepeatTheSameBits) {
  const std::vector<WireFrame> frames = step(4);
  StreamClient client(channel());
  ASSERT_TRUE(client.open("cut"));
  client.send(frames[0], 0, film_time_ns(0));
  client.send(frames[3], 1, film_time_ns(1), /*cut=*/true);
  StreamResult first, second, again;
  ASSERT_TRUE(client.read(first) && client.read(second));
  EXPECT_EQ(client.opened().session(), "cut");
  EXPECT_GE(client.opened().max_frames_in_flight(), 1u);
  EXPECT_TRUE(second.header.cut());
  EXPECT_EQ(second.header.exposure(), second.header.target());
  client.send(frames[3], 1, film_time_ns(1));
  ASSERT_TRUE(client.read(again));
  EXPECT_EQ(again.pixels, second.pixels);
  EXPECT_EQ(again.header.exposure(), second.header.exposure());
  client.half_close();
  EXPECT_OK(client.finish());
}

TEST_P(Stream, LookaheadSpreadsASpikeAndIsThePlainRecursionAtZero) {
  std::vector<WireFrame> frames;
  for (int i = 0; i < 12; ++i) frames.push_back(grey(i == 6 ? 41.0f : 0.01f));
  v1::StreamOpen open = open_of("ahead");
  open.set_lookahead(3);
  const std::vector<StreamResult> ahead = stream_all(channel(), open, frames);
  const std::vector<StreamResult> plain = stream_all(channel(), open_of("plain"), frames);
  ASSERT_EQ(ahead.size(), frames.size());
  EXPECT_LT(ahead[5].header.exposure(), plain[5].header.exposure()) << "it saw the spike come";
  EXPECT_LT(ahead[6].header.exposure(), plain[6].header.exposure());
  EXPECT_EQ(plain[5].header.exposure(), plain[0].header.exposure());
}

TEST_P(Stream, DetectsACutButNoLightThatGoesOn) {
  WireFrame other = grey(0.01f, 640, 512);  // with a tile or more for every cell of the print
  auto* halves = reinterpret_cast<uint16_t*>(other.pixels.data());
  for (size_t i = 0; i < other.pixels.size() / 4; ++i) halves[i] = 0x5c00;  // the upper half is 256
  v1::StreamOpen open = open_of("detect");
  open.set_cut_threshold_ev(1.0);
  const std::vector<StreamResult> results =
      stream_all(channel(), open, {grey(0.01f, 640, 512), grey(40.0f, 640, 512), other, other});
  ASSERT_EQ(results.size(), 4u);
  EXPECT_FALSE(results[1].header.cut());
  EXPECT_TRUE(results[2].header.cut());
  EXPECT_EQ(results[2].header.exposure(), results[2].header.target());
  EXPECT_FALSE(results[3].header.cut());
}

TEST_P(Stream, SettingsChangeAtTheFrameTheyName) {
  const std::vector<WireFrame> frames = step(2);
  v1::Settings manual = at_ev(3.0);
  manual.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  StreamClient client(channel());
  ASSERT_TRUE(client.open("change"));
  ASSERT_TRUE(client.change(2, manual));
  for (uint64_t i = 0; i < 4; ++i) ASSERT_TRUE(client.send(frames[0], i, film_time_ns(i)));
  client.half_close();
  const std::vector<StreamResult> results = client.read_all();
  ASSERT_EQ(results.size(), 4u);
  EXPECT_NE(results[1].header.exposure(), 8.0);
  EXPECT_EQ(results[2].header.exposure(), 8.0);
  EXPECT_EQ(results[2].header.format(), v1::OUTPUT_FORMAT_RGBA16);
  EXPECT_EQ(results[3].header.exposure(), 8.0);
  EXPECT_OK(client.finish());
}

// A promise is kept frame by frame: draft has no bound where something blooms.
TEST_P(Stream, APromiseChoosesATierForEachFrame) {
  v1::StreamOpen open = open_of("tiers");
  open.mutable_settings()->set_max_error_codes(0.1);
  const WireFrame dim = flat(70, 50, {0.5f, 0.3f, 0.2f, 1.0f});
  const TexelFunction lights = [](uint32_t x, uint32_t y) -> Texel {
    const float v = x % 16 == 3 && y % 16 == 5 ? 200.0f : 0.3f;
    return {v, v, v, 1.0f};
  };
  const WireFrame bright = make_frame(70, 50, v1::PIXEL_FORMAT_RGBA16F, lights);
  std::vector<WireFrame> frames;
  for (int i = 0; i < 8; ++i) frames.push_back(i % 2 == 0 ? dim : bright);
  const std::vector<StreamResult> results = stream_all(channel(), open, frames);
  ASSERT_EQ(results.size(), frames.size());
  for (size_t i = 0; i < results.size(); ++i) {
    const v1::ResultHeader& header = results[i].header;
    EXPECT_EQ(header.tier(), i % 2 == 0 ? "draft" : "standard") << i << ": " << header.tier_reason();
    EXPECT_TRUE(header.has_error_bound_codes()) << i;
    EXPECT_LE(header.error_bound_codes(), 0.1) << i;
    EXPECT_TRUE(says(header.tier_reason(), "keeps max_error_codes 0.1"));
  }
}

// There are more such frames in a row than the session can hold, and nothing waits forever.
TEST_P(Stream, RefusedFramesDoNotHoldLookAheadUp) {
  v1::StreamOpen open = open_of("refused");
  open.mutable_settings()->set_bad_values(v1::BAD_VALUES_REJECT);
  open.set_lookahead(2);
  const WireFrame good = natural(33, 21);
  WireFrame bad = good;
  const uint16_t nan = 0x7e00;
  std::memcpy(bad.pixels.data(), &nan, sizeof nan);
  StreamClient client(channel(), true, absl::Now() + absl::Seconds(30));
  ASSERT_TRUE(client.open(open));
  constexpr uint64_t kFrames = 10;
  for (uint64_t i = 0; i < kFrames; ++i) {
    client.send(i == 0 || i + 1 == kFrames ? good : bad, i, film_time_ns(i));
  }
  client.half_close();
  const std::vector<StreamResult> results = client.read_all();
  ASSERT_EQ(results.size(), kFrames);
  for (uint64_t i = 0; i < kFrames; ++i) {
    EXPECT_EQ(results[i].sequence(), i);
    EXPECT_EQ(results[i].failed, i > 0 && i + 1 < kFrames);
  }
  EXPECT_OK(client.finish());
}

TEST_P(Stream, ARefusedFrameIsItsOwnAndTheSessionGoesOn) {
  v1::Settings reject;
  reject.set_bad_values(v1::BAD_VALUES_REJECT);
  WireFrame bad = natural(33, 21);
  const uint16_t nan = 0x7e00;
  std::memcpy(bad.pixels.data() + 5 * 8, &nan, sizeof nan);
  StreamClient client(channel());
  ASSERT_TRUE(client.open("bad", reject));
  client.send(natural(33, 21), 0, film_time_ns(0));
  client.send(bad, 1, film_time_ns(1));
  client.send(natural(33, 21), 2, film_time_ns(2));
  client.half_close();
  const std::vector<StreamResult> results = client.read_all();
  ASSERT_EQ(results.size(), 3u);
  ASSERT_TRUE(results[1].failed);
  EXPECT_EQ(results[1].failure.code(), static_cast<uint32_t>(grpc::INVALID_ARGUMENT));
  EXPECT_TRUE(says(results[1].failure.message(), "x 5, y 0"));
  EXPECT_EQ(results[2].header.exposure_before(), results[0].header.exposure());
  EXPECT_OK(client.finish());
}

TEST_P(Stream, EncodedResultsHoldTheSamePixels) {
  const WireFrame frame = natural(131, 67);
  const std::vector<StreamResult> raw = stream_all(channel(), open_of("raw"), {frame});
  v1::StreamOpen open = open_of("png");
  open.set_encoding(v1::ENCODING_PNG);
  const std::vector<StreamResult> encoded = stream_all(channel(), open, {frame});
  ASSERT_EQ(encoded.size(), 1u);
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_memory(&png, encoded[0].pixels.data(), encoded[0].pixels.size()));
  ASSERT_EQ(png.width, 131u);
  ASSERT_EQ(png.height, 67u);
  png.format = PNG_FORMAT_RGBA;
  std::string pixels(PNG_IMAGE_SIZE(png), '\0');
  ASSERT_TRUE(png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr)) << png.message;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (i % 4 == 3) continue;
    ASSERT_EQ(pixels[i], raw.at(0).pixels[i]) << "byte " << i;
  }
  open.set_session("jpeg");
  open.set_encoding(v1::ENCODING_JPEG);
  const std::vector<StreamResult> jpeg = stream_all(channel(), open, {frame});
  EXPECT_EQ(jpeg.at(0).pixels.substr(0, 2), "\xff\xd8");
}

TEST_P(Stream, AFrameOfOneRowIsEncodedToo) {
  for (const v1::Encoding encoding : {v1::ENCODING_PNG, v1::ENCODING_JPEG}) {
    v1::StreamOpen open = open_of("row");
    open.set_encoding(encoding);
    EXPECT_EQ(stream_all(channel(), open, {natural(5, 1)}).size(), 1u);
  }
}

TEST_P(Stream, ResumesFromAnyResultWithTheSameBits) {
  const std::vector<WireFrame> frames = step(6);
  for (const uint32_t lookahead : {0u, 2u}) {
    v1::StreamOpen open = open_of("whole");
    open.set_lookahead(lookahead);
    const std::vector<StreamResult> whole = stream_all(channel(), open, frames);
    ASSERT_EQ(whole.size(), frames.size());
    for (size_t stop = 0; stop + 1 < frames.size(); ++stop) {
      open.set_resume_token(whole[stop].token());
      StreamClient client(channel());
      ASSERT_TRUE(client.open(open));
      std::thread writer([&] {
        for (size_t i = stop + 1; i < frames.size(); ++i) client.send(frames[i], i, film_time_ns(i));
        client.half_close();
      });
      const std::vector<StreamResult> rest = client.read_all();
      writer.join();
      EXPECT_OK(client.finish());
      EXPECT_EQ(client.opened().epoch(), 1u);
      ASSERT_EQ(rest.size(), frames.size() - stop - 1);
      for (size_t i = 0; i < rest.size(); ++i) {
        EXPECT_EQ(rest[i].pixels, whole[stop + 1 + i].pixels);
        EXPECT_EQ(rest[i].header.exposure(), whole[stop + 1 + i].header.exposure());
      }
    }
  }
}

TEST_P(Stream, TokensThatDoNotFitAreRefused) {
  const std::string token = stream_all(channel(), open_of("tokens"), {natural(16, 16)}).at(0).token();
  const auto refused = [&](const std::string& session, const v1::Settings& settings,
                           const std::string& with) {
    StreamClient client(channel());
    client.open(session, settings, with);
    return client.finish();
  };
  v1::Settings other;
  other.set_curve(v1::TONE_CURVE_HABLE);
  EXPECT_EQ(refused("another", {}, token).error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_EQ(refused("tokens", other, token).error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_EQ(refused("tokens", {}, token.substr(0, token.size() - 1)).error_code(), grpc::FAILED_PRECONDITION);
  std::string forged = token;
  forged[forged.size() / 2] ^= 1;
  EXPECT_EQ(refused("tokens", {}, forged).error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_EQ(refused("tokens", {}, std::string(v1::kMaxTokenBytes + 1, 'x')).error_code(),
            grpc::INVALID_ARGUMENT);
}

TEST_P(Stream, OneCallAtATimeHasASession) {
  StreamClient first(channel());
  ASSERT_TRUE(first.open("mine"));
  first.send(natural(16, 16), 0, 0);
  StreamResult result;
  ASSERT_TRUE(first.read(result));
  StreamClient second(channel());
  second.open("mine");
  EXPECT_EQ(second.finish().error_code(), grpc::ALREADY_EXISTS);
  StreamClient third(channel());
  ASSERT_TRUE(third.open("mine", {}, result.token()));
  third.send(natural(16, 16), 1, 1);
  ASSERT_TRUE(third.read(result));
  EXPECT_EQ(result.sequence(), 1u);
  EXPECT_EQ(first.finish().error_code(), grpc::ABORTED) << "the session went on elsewhere";
  third.half_close();
  EXPECT_OK(third.finish());
}

// A client that loses two calls in a row has the same token for both, whatever the server knows about them.
TEST_P(Stream, ATokenIsGoodUntilAResultHasComeBack) {
  StreamClient first(channel());
  ASSERT_TRUE(first.open("twice"));
  first.send(natural(16, 16), 0, 0);
  StreamResult result;
  ASSERT_TRUE(first.read(result));
  const std::string token = result.token();
  StreamClient second(channel());
  ASSERT_TRUE(second.open("twice", {}, token));
  second.send(natural(16, 16), 1, 1);
  ASSERT_TRUE(second.read(result));
  EXPECT_EQ(first.finish().error_code(), grpc::ABORTED);
  StreamClient third(channel());
  ASSERT_TRUE(third.open("twice", {}, token));
  third.send(natural(16, 16), 1, 1);
  StreamResult again;
  ASSERT_TRUE(third.read(again));
  EXPECT_TRUE(again.pixels == result.pixels);
  EXPECT_EQ(second.finish().error_code(), grpc::ABORTED);
  // Once a session continues from the later token, the earlier one is too old.
  StreamClient fourth(channel());
  ASSERT_TRUE(fourth.open("twice", {}, again.token()));
  fourth.send(natural(16, 16), 2, 2);
  ASSERT_TRUE(fourth.read(result));
  StreamClient late(channel());
  late.open("twice", {}, token);
  EXPECT_EQ(late.finish().error_code(), grpc::FAILED_PRECONDITION);
}

// Frames without alpha and compressed ones, and images without alpha: the same bits in fewer bytes.

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

// A session in parts: states, given exposures, and sessions without images. Together the parts give the bits
// of one run.

constexpr size_t kFrames = 20;
constexpr double kCutEv = 0.5;

// Three scenes that differ in their pictures, in light that varies from frame to frame.
Film scenes() {
  auto film = std::make_shared<std::vector<WireFrame>>();
  for (uint32_t i = 0; i < kFrames; ++i) {
    const uint32_t scene = i < 5 ? 0 : i < 13 ? 1 : 2;
    const float light = std::exp2(3 * std::sin(0.7f * static_cast<float>(i)));
    film->push_back(make_frame(256, 192, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) -> Texel {
      const bool lit = scene == 0 ? x < 128 : scene == 1 ? y < 96 : x >= 128;
      const float value = light * (lit ? 1.0f : 0.05f) * (0.5f + noise(x, y, i));
      return {value, value, 0.5f * value, 1};
    }));
  }
  return film;
}

struct Shown {
  v1::ResultHeader header;
  std::string image;
};

class SessionParts : public ServiceTest {
 protected:
  static void SetUpTestSuite() {
    ServiceTest::SetUpTestSuite();
    film_ = new Film(scenes());
  }
  static void TearDownTestSuite() {
    delete film_;
    ServiceTest::TearDownTestSuite();
  }

  using Prepare = std::function<void(SessionFrame&)>;

  // Runs the frames `first` .. `last` - 1 as one session.
  static std::vector<Shown> run(const SessionOptions& options, size_t first = 0, size_t last = kFrames,
                                const Prepare& prepare = {}) {
    const SessionRun run = run_frames(Session::open({channel()}, options), first, last, [&](size_t i) {
      SessionFrame frame = frame_of(*film_, i);
      if (prepare) prepare(frame);
      return frame;
    });
    EXPECT_OK(run.status);
    std::vector<Shown> shown;
    for (size_t i = 0; i < run.images.size(); ++i) shown.push_back({run.headers[i], run.images[i]});
    return shown;
  }

  // `part` are the frames of `whole` from `first` on.
  static void expect_same(const std::vector<Shown>& whole, const std::vector<Shown>& part, size_t first) {
    for (size_t i = 0; i < part.size(); ++i) {
      const Shown& expected = whole.at(first + i);
      EXPECT_EQ(part[i].header.sequence(), expected.header.sequence());
      EXPECT_EQ(part[i].header.exposure(), expected.header.exposure()) << "frame " << first + i;
      EXPECT_TRUE(part[i].image == expected.image) << "frame " << first + i;
    }
  }

  static inline Film* film_ = nullptr;
};
INSTANTIATE_TEST_SUITE_P(Transport, SessionParts, ::testing::Bool(), transport_name);

SessionOptions dithered(double cut_threshold_ev) {
  SessionOptions options;
  options.settings.set_dither(true);
  options.cut_threshold_ev = cut_threshold_ev;
  return options;
}

TEST_P(SessionParts, AStateContinuesASessionBitForBit) {
  for (const auto domain : {v1::Adaptation::DOMAIN_LOG, v1::Adaptation::DOMAIN_LINEAR}) {
    for (const double threshold : {0.0, kCutEv}) {
      SessionOptions options = dithered(threshold);
      options.settings.mutable_exposure()->mutable_adaptation()->set_domain(domain);
      options.return_state = true;
      const auto cut = [](SessionFrame& frame) { frame.cut = frame.sequence == 10; };
      const std::vector<Shown> whole = run(options, 0, kFrames, cut);
      ASSERT_EQ(whole.size(), kFrames);
      EXPECT_EQ(whole[13].header.cut(), threshold > 0) << "a detected cut belongs to the test";
      EXPECT_EQ(whole[7].header.state().picture_size(), threshold > 0 ? 64 : 0);
      for (const size_t end : {1u, 8u, 10u, 13u}) {
        SessionOptions rest = options;
        rest.state = run(options, 0, end, cut).back().header.state();
        const std::vector<Shown> part = run(rest, end, kFrames, cut);
        ASSERT_EQ(part.size(), kFrames - end);
        expect_same(whole, part, end);
        EXPECT_EQ(part[0].header.exposure_before(), whole[end].header.exposure_before());
        EXPECT_EQ(part.back().header.state().SerializeAsString(),
                  whole.back().header.state().SerializeAsString());
      }
    }
  }
}

TEST_P(SessionParts, WithoutImagesTheExposuresAreThoseOfASessionWithImages) {
  for (const uint32_t lookahead : {0u, 4u}) {
    SessionOptions options = dithered(kCutEv);
    options.lookahead = lookahead;
    options.return_state = true;
    const std::vector<Shown> drawn = run(options);
    options.encoding = v1::ENCODING_NONE;
    const std::vector<Shown> metered = run(options);
    ASSERT_EQ(metered.size(), kFrames);
    for (size_t i = 0; i < kFrames; ++i) {
      const v1::ResultHeader &with = drawn[i].header, &without = metered[i].header;
      EXPECT_EQ(metered[i].image, "");
      EXPECT_EQ(without.encoding(), v1::ENCODING_NONE);
      EXPECT_EQ(without.encoded_bytes(), 0u);
      EXPECT_EQ(without.exposure(), with.exposure()) << i;
      EXPECT_EQ(without.exposure_before(), with.exposure_before()) << i;
      EXPECT_EQ(without.target(), with.target()) << i;
      EXPECT_EQ(without.target_before_limits(), with.target_before_limits()) << i;
      EXPECT_EQ(without.cut(), with.cut()) << i;
      EXPECT_EQ(without.statistics().SerializeAsString(), with.statistics().SerializeAsString()) << i;
      EXPECT_EQ(without.state().SerializeAsString(), with.state().SerializeAsString()) << i;
      EXPECT_EQ(without.plan(without.plan_size() - 1), "no image: the encoding is NONE");
    }
    EXPECT_TRUE(wait_until_idle(connection()));
  }
}

TEST_P(SessionParts, GivenExposuresGiveTheImagesOfOneRunInAnyParts) {
  SessionOptions options = dithered(kCutEv);
  options.lookahead = 4;
  options.settings.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
  const std::vector<Shown> whole = run(options);
  ASSERT_EQ(whole.size(), kFrames);
  SessionOptions part = dithered(0);
  part.settings = options.settings;
  const auto give = [&whole](SessionFrame& frame) {
    frame.exposure = whole[frame.sequence].header.exposure();
  };
  for (const auto& [first, last] : {std::pair<size_t, size_t>{0, 7}, {7, 8}, {8, 20}}) {
    const std::vector<Shown> shown = run(part, first, last, give);
    ASSERT_EQ(shown.size(), last - first);
    expect_same(whole, shown, first);
    for (size_t i = 0; i < shown.size(); ++i) {
      EXPECT_EQ(shown[i].header.statistics().mean_log2_luminance(),
                whole[first + i].header.statistics().mean_log2_luminance());
    }
  }
}

TEST_P(SessionParts, RenderAndMeterTakeAGivenExposure) {
  const std::vector<Shown> whole = run({}, 0, 3);
  ASSERT_EQ(whole.size(), 3u);
  FrameView frame = view((*film_)->at(2), 2);
  frame.exposure = whole[2].header.exposure();
  ASSERT_OK_AND_ASSIGN(const RenderResult alone, connection().render({}, frame));
  EXPECT_EQ(alone.header.exposure(), whole[2].header.exposure());
  EXPECT_EQ(alone.header.target(), whole[2].header.target());
  EXPECT_TRUE(whole[2].image == std::string(reinterpret_cast<const char*>(alone.data.get()), alone.bytes));
  ASSERT_OK_AND_ASSIGN(const v1::MeterResponse metered, connection().meter({}, frame));
  EXPECT_EQ(metered.exposure(), *frame.exposure);
  EXPECT_EQ(metered.target(), alone.header.target());
  frame.exposure = 0x1p41;
  EXPECT_TRUE(absl::IsInvalidArgument(connection().render({}, frame).status()));
}

TEST_P(SessionParts, AStateThatCannotBeIsRefused) {
  SessionOptions options;
  options.state.emplace().set_exposure(-1);
  const absl::StatusOr<Session> session = Session::open({channel()}, options);
  EXPECT_REFUSED(kInvalidArgument, "open.state.exposure is -1", session);
}

TEST_P(SessionParts, WithoutImagesLookAheadNeedsNoMemoryOfItsOwn) {
  // 17 of these frames are more than the server's memory budget of 256 MiB.
  const auto film =
      std::make_shared<const std::vector<WireFrame>>(20, flat(2048, 2048, {0.5f, 0.5f, 0.5f, 1}));
  SessionOptions options;
  options.lookahead = 16;
  EXPECT_TRUE(absl::IsResourceExhausted(run_session(Session::open({channel()}, options), film).status));
  options.encoding = v1::ENCODING_NONE;
  const SessionRun metered = run_session(Session::open({channel()}, options), film);
  EXPECT_OK(metered.status);
  EXPECT_EQ(metered.images, std::vector<std::string>(20, ""));
}

TEST_P(SessionParts, WithoutImagesABadFrameFailsAlone) {
  WireFrame bad = flat(64, 64, {0.5f, 0.5f, 0.5f, 1});
  bad.pixels[1] = std::byte{0x7e};  // a NaN
  SessionOptions options;
  options.encoding = v1::ENCODING_NONE;
  options.lookahead = 2;
  options.settings.set_bad_values(v1::BAD_VALUES_REJECT);
  const auto film = std::make_shared<const std::vector<WireFrame>>(
      std::vector{flat(64, 64, {0.5f, 0.5f, 0.5f, 1}), bad, flat(64, 64, {2, 2, 2, 1})});
  ASSERT_OK_AND_ASSIGN(Session session, Session::open({channel()}, options));
  for (size_t i = 0; i < 3; ++i) ASSERT_OK(session.submit(frame_of(film, i)));
  session.finish();
  for (size_t i = 0; i < 3; ++i) {
    const absl::StatusOr<std::optional<FrameResult>> result = session.next_result();
    ASSERT_TRUE(result.ok() && *result) << result.status();
    EXPECT_EQ((*result)->status.ok(), i != 1) << (*result)->status;
  }
}

}  // namespace
}  // namespace candela::testing
