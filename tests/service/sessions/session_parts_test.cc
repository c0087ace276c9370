// A session in parts: states, given exposures, and sessions without images. Together the parts give the bits
// of one run.
#include <cmath>
#include <optional>
#include <thread>

#include "tests/service/service_fixture.h"
#include "tests/service/sessions/session_run.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

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
