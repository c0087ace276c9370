#include "server/session/sessions.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>

#include "proto/candela/v1/limits.h"
#include "server/session/render_start.h"
#include "server/session/resume_token.h"
#include "server/session/stream_start.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class CountingCall final : public SessionCall {
 public:
  void go_away() override { ++told; }
  void give_up() override {}
  int told = 0;
};

class DrainTest : public ::testing::Test {
 protected:
  std::shared_ptr<Drain> begin() {
    return Drain::begin(calls_, sessions_, table_, [this](bool drained) {
      EXPECT_EQ(ended_, std::nullopt) << "ended twice";
      ended_ = drained;
    });
  }
  void enter(CallGate& gate) { EXPECT_TRUE(gate.enter().ok()); }
  void leave(CallGate& gate) {
    gate.give_up_place();
    gate.leave();
  }

  CallGate calls_{"calls", 2};
  CallGate sessions_{"sessions", 2};
  SessionTable table_;
  std::optional<bool> ended_;
};

TEST_F(DrainTest, AnEmptyServerIsDrainedAtOnceAndTakesNobody) {
  begin();
  EXPECT_EQ(ended_, true);
  EXPECT_TRUE(absl::IsUnavailable(calls_.enter()));
  EXPECT_TRUE(absl::IsUnavailable(sessions_.enter()));
}

TEST_F(DrainTest, SessionsAreToldAndTheLastCallToLeaveEndsIt) {
  const auto session = std::make_shared<CountingCall>();
  ASSERT_TRUE(table_.enter("s", 0, /*resumed=*/false, session).ok());
  enter(calls_);
  enter(calls_);
  enter(sessions_);
  const auto drain = begin();
  EXPECT_EQ(session->told, 1);
  leave(sessions_);
  leave(calls_);
  calls_.give_up_place();
  EXPECT_EQ(ended_, std::nullopt) << "a client was not told yet";
  calls_.leave();
  EXPECT_EQ(ended_, true);
  drain->on_time();
}

TEST_F(DrainTest, ItsTimeEndsItAndWhoLeavesLaterDoesNot) {
  enter(calls_);
  begin()->on_time();
  EXPECT_EQ(ended_, false);
  leave(calls_);
}

// States and given exposures: sessions that continue another one, and frames that bring their exposure.

constexpr int64_t kFrameOf24Ns = 41'666'667;  // 24 a second

FrameStats stats_at(double mean_log2_luminance) {
  FrameStats stats;
  stats.mean_log2_luminance = mean_log2_luminance;
  stats.metered_weight = 1;
  for (size_t i = 0; i < stats.print.size(); ++i) {
    stats.print[i] = static_cast<float>(std::sin(mean_log2_luminance * static_cast<double>(i)));
  }
  return stats;
}

v1::Exposure defaults() { return Settings()->exposure(); }
double target_of(double mean) { return exposure_target(defaults(), mean); }

// Adds and meters frame `i`. Returns the frames that are decided then.
std::vector<FrameExposure> show(ExposureTrack& track, uint64_t i, double mean, bool cut = false,
                                std::optional<double> given = std::nullopt) {
  EXPECT_OK(track.add(i, static_cast<int64_t>(i) * kFrameOf24Ns, cut, defaults(), given));
  track.metered(i, stats_at(mean));
  std::vector<FrameExposure> decided;
  while (std::optional<FrameExposure> one = track.next()) decided.push_back(*one);
  return decided;
}

// A state as it comes back from a client that kept it as bytes.
ExposurePoint sent_back(const ExposurePoint& point) {
  v1::SessionState state;
  EXPECT_TRUE(state.ParseFromString(state_of(point).SerializeAsString()));
  const absl::StatusOr<ExposurePoint> back = point_from(state);
  EXPECT_OK(back);
  return back.value_or(ExposurePoint());
}

TEST(SessionState, ATrackContinuesFromAnyStateWithTheSameBits) {
  for (const double threshold : {0.0, 0.5}) {
    const auto mean = [](uint64_t i) { return 3 * std::sin(0.7 * static_cast<double>(i)); };
    ExposureTrack whole(0, threshold, {});
    std::vector<ExposurePoint> points;
    for (uint64_t i = 0; i < 12; ++i) points.push_back(show(whole, i, mean(i), i == 5).at(0).point);
    for (uint64_t end = 1; end < 12; ++end) {
      ExposureTrack rest(0, threshold, sent_back(points[end - 1]));
      for (uint64_t i = end; i < 12; ++i) {
        EXPECT_EQ(show(rest, i, mean(i), i == 5).at(0).point, points[i]) << "from " << end << ", frame " << i;
      }
    }
  }
}

TEST(SessionState, HoldsACutThatIsPendingAndCellsThatAreNotMetered) {
  ExposurePoint point{.begun = true, .sequence = 9, .media_time_ns = 77, .exposed = {0.3, 0.1}, .print = {}};
  point.cut_pending = true;
  point.print.emplace().fill(-0.1f);
  point.print->back() = std::numeric_limits<float>::quiet_NaN();
  const ExposurePoint back = sent_back(point);
  EXPECT_TRUE(back.begun);
  EXPECT_EQ(back.sequence, 9u);
  EXPECT_EQ(back.media_time_ns, 77);
  EXPECT_EQ(back.exposed, point.exposed);
  EXPECT_TRUE(back.cut_pending);
  EXPECT_EQ(back.print->front(), -0.1f);
  EXPECT_TRUE(std::isnan(back.print->back()));
  ExposureTrack track(0, 0.0, back);
  const ExposurePoint next = show(track, 10, 4.0).at(0).point;
  EXPECT_TRUE(next.cut);
  EXPECT_EQ(next.exposed.exposure, target_of(4.0));
}

TEST(SessionState, FramesMustNotComeBeforeIt) {
  ExposureTrack track(
      0, 0.0,
      sent_back({.begun = true, .sequence = 9, .media_time_ns = 900, .exposed = {1, 1}, .print = {}}));
  EXPECT_FALSE(track.add(8, 900, false, defaults()).ok());
  EXPECT_FALSE(track.add(10, 899, false, defaults()).ok());
  EXPECT_OK(track.add(10, 900, false, defaults()));
}

v1::StreamOpen open_with_state() {
  v1::StreamOpen open;
  open.set_session("s");
  open.mutable_state()->set_exposure(2.0);
  open.mutable_state()->set_target(0.5);
  return open;
}

TEST(SessionState, OnlyAWholeAndFiniteOneIsTaken) {
  ASSERT_OK_AND_ASSIGN(const StreamStart good, stream_start_from(open_with_state()));
  EXPECT_EQ(good.state->exposed, (Exposed{2.0, 0.5}));
  EXPECT_FALSE(good.return_state);
  const auto refused = [](const char* words, const std::function<void(v1::StreamOpen&)>& spoil) {
    v1::StreamOpen open = open_with_state();
    spoil(open);
    EXPECT_REFUSED(kInvalidArgument, words, stream_start_from(open));
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {0.0, -1.0, nan, std::numeric_limits<double>::infinity(), 0x1p41, 0x1p-41}) {
    refused("open.state.exposure", [bad](v1::StreamOpen& open) { open.mutable_state()->set_exposure(bad); });
    refused("open.state.target", [bad](v1::StreamOpen& open) { open.mutable_state()->set_target(bad); });
  }
  refused("open.state.exposure is 0", [](v1::StreamOpen& open) { open.mutable_state()->Clear(); });
  refused("media_time_ns is -1", [](v1::StreamOpen& open) { open.mutable_state()->set_media_time_ns(-1); });
  refused("media_time_ns",
          [](v1::StreamOpen& open) { open.mutable_state()->set_media_time_ns(v1::kMediaTimeNs.max + 1); });
  for (const int cells : {1, 63, 65, 1000}) {
    refused("open.state.picture has", [cells](v1::StreamOpen& open) {
      for (int i = 0; i < cells; ++i) open.mutable_state()->add_picture(0.0f);
    });
  }
  refused("a cell of inf", [](v1::StreamOpen& open) {
    for (int i = 0; i < 64; ++i) {
      open.mutable_state()->add_picture(i == 40 ? std::numeric_limits<float>::infinity() : 0.0f);
    }
  });
  refused("both set", [](v1::StreamOpen& open) { open.set_resume_token("token"); });
}

TEST(SessionState, ASessionWithoutImagesIsKnown) {
  v1::StreamOpen open;
  open.set_session("s");
  open.set_encoding(v1::ENCODING_NONE);
  open.set_return_state(true);
  ASSERT_OK_AND_ASSIGN(const StreamStart start, stream_start_from(open));
  EXPECT_FALSE(start.draws());
  EXPECT_TRUE(start.return_state);
  open.set_encoding(v1::ENCODING_RAW);
  EXPECT_TRUE(stream_start_from(open)->draws());
  open.set_encoding(static_cast<v1::Encoding>(5));
  EXPECT_TRUE(says(stream_start_from(open).status().message(), "NONE (4)"));
}

TEST(GivenExposure, ReplacesTheExposureAndNotTheTarget) {
  ExposureTrack track(0, 0.0, {});
  show(track, 0, 0.0);
  const ExposurePoint given = show(track, 1, 2.0, false, 5.0).at(0).point;
  EXPECT_EQ(given.exposed, (Exposed{5.0, target_of(2.0)}));
  EXPECT_EQ(given.before, target_of(0.0));
  const ExposurePoint next = show(track, 2, 2.0).at(0).point;
  EXPECT_EQ(next.before, 5.0) << "the next frame adapts from it";
  EXPECT_EQ(
      next.exposed.exposure,
      adapt_exposure(defaults().adaptation(), PreviousExposure{5.0, kFrameOf24Ns * 1e-9}, target_of(2.0)));
}

TEST(GivenExposure, WaitsForNoLaterFrameAndHasItsWeightInTheLookAheadOfEarlierOnes) {
  ExposureTrack track(2, 0.0, {});
  EXPECT_TRUE(show(track, 0, 1.0).empty());
  EXPECT_TRUE(show(track, 1, 2.0, false, 5.0).empty()) << "the frame before it waits";
  const auto decided = show(track, 2, 6.0, false, 7.0);
  ASSERT_EQ(decided.size(), 3u);
  EXPECT_EQ(decided[0].point.exposed.target, target_of((3 * 1.0 + 2 * 2.0 + 6.0) / 6));
  EXPECT_EQ(decided[1].point.exposed, (Exposed{5.0, target_of(2.0)}));
  EXPECT_EQ(decided[2].point.exposed, (Exposed{7.0, target_of(6.0)}));
}

TEST(GivenExposure, AFrameWithNothingMeteredTakesItAndPassesItsCutOn) {
  ExposureTrack track(0, 0.0, {});
  ASSERT_OK(track.add(0, 0, /*cut=*/true, defaults(), 3.0));
  FrameStats dark;
  dark.mean_log2_luminance = kNothingMetered;
  track.metered(0, dark);
  const std::optional<FrameExposure> first = track.next();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->point.exposed, (Exposed{3.0, target_of(kNothingMetered)}));
  EXPECT_TRUE(show(track, 1, 1.0).at(0).point.cut);
}

TEST(GivenExposure, IsAFactorAndARepeatBringsTheSame) {
  ExposureTrack track(0, 0.0, {});
  for (const double bad : {0.0, -2.0, std::nan(""), 0x1p41}) {
    EXPECT_REFUSED(kInvalidArgument, "frame.exposure is", track.add(0, 0, false, defaults(), bad));
  }
  show(track, 0, 1.0, false, 5.0);
  EXPECT_FALSE(track.add(0, 0, false, defaults(), 6.0).ok());
  EXPECT_EQ(show(track, 0, 9.0, false, 5.0).at(0).point.exposed.exposure, 5.0);
  ExposureTrack resumed(0, 0.0, show(track, 1, 1.0, false, 4.0).at(0).point);
  EXPECT_FALSE(resumed.add(1, kFrameOf24Ns, false, defaults(), 5.0).ok());
  EXPECT_EQ(show(resumed, 1, 1.0, false, 4.0).at(0).point.exposed.exposure, 4.0);
}

TEST(GivenExposure, RenderTakesItAloneOrAdaptsFromThePreviousOne) {
  v1::RenderRequest request;
  v1::FrameHeader& frame = *request.mutable_start()->mutable_frame();
  frame.set_width(2);
  frame.set_height(2);
  frame.set_format(v1::PIXEL_FORMAT_RGBA16F);
  const FrameLimits limits{v1::kMaxDimension, v1::kDefaultMaxFrameBytes};
  EXPECT_FALSE(render_start_from(request, limits)->given);
  frame.set_exposure(0.7);
  EXPECT_EQ(render_start_from(request, limits)->given, 0.7);
  request.mutable_start()->mutable_previous()->set_exposure(1);
  EXPECT_TRUE(says(render_start_from(request, limits).status().message(), "both set"));
  request.mutable_start()->clear_previous();
  frame.set_exposure(std::nan(""));
  EXPECT_TRUE(says(render_start_from(request, limits).status().message(), "frame.exposure is nan"));
}

}  // namespace
}  // namespace candela
