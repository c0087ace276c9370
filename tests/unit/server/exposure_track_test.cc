// A session's exposure over its frames, as docs/pipeline.md sections 3 and 7 define it.
#include "server/session/exposure_track.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

#include "proto/candela/v1/limits.h"
#include "server/session/render_start.h"
#include "server/session/resume_token.h"
#include "server/session/stream_start.h"
#include "tests/support/status.h"

namespace candela {
namespace {

constexpr int64_t kFrameNs = 41'666'667;  // 24 a second

FrameStats metered_at(double mean_log2_luminance) {
  FrameStats stats;
  stats.mean_log2_luminance = mean_log2_luminance;
  stats.metered_weight = 1;
  stats.print.fill(static_cast<float>(mean_log2_luminance));
  return stats;
}

// A frame with nothing metered. Its picture, which nothing may read, differs from every other.
FrameStats unmetered() {
  FrameStats stats;
  stats.mean_log2_luminance = std::log2(0.18);
  for (size_t i = 0; i < stats.print.size(); ++i) stats.print[i] = i % 2 == 0 ? -50.0f : 50.0f;
  return stats;
}

// A track of 24 frames a second, numbered from 0.
struct Film {
  explicit Film(uint32_t lookahead = 0, double cut_threshold_ev = 0.0, ExposurePoint point = {})
      : track(lookahead, cut_threshold_ev, point) {}

  absl::Status add(uint64_t sequence, bool cut = false) {
    return track.add(sequence, static_cast<int64_t>(sequence) * kFrameNs, cut, settings);
  }
  // Adds and meters a frame. Returns the frames that are decided then.
  std::vector<FrameExposure> show(uint64_t sequence, double mean, bool cut = false) {
    EXPECT_OK(add(sequence, cut));
    track.metered(sequence, metered_at(mean));
    return decided();
  }
  std::vector<FrameExposure> show_unmetered(uint64_t sequence, bool cut = false) {
    EXPECT_OK(add(sequence, cut));
    track.metered(sequence, unmetered());
    return decided();
  }
  std::vector<FrameExposure> decided() {
    std::vector<FrameExposure> all;
    while (std::optional<FrameExposure> one = track.next()) all.push_back(*one);
    return all;
  }

  // Ends the track. Returns the frames that are decided then.
  std::vector<FrameExposure> ended() {
    track.end();
    return decided();
  }

  v1::Exposure settings = Settings()->exposure();
  ExposureTrack track;
};

void append(std::vector<FrameExposure>& all, const std::vector<FrameExposure>& more) {
  all.insert(all.end(), more.begin(), more.end());
}

double target(double mean) { return exposure_target(Settings()->exposure(), mean); }

TEST(ExposureTrack, FirstFrameTakesItsTarget) {
  Film film;
  const auto decided = film.show(7, -3.0);
  ASSERT_EQ(decided.size(), 1u);
  EXPECT_EQ(decided[0].sequence, 7u);
  EXPECT_EQ(decided[0].point.exposed.exposure, target(-3.0));
  EXPECT_EQ(decided[0].point.before, target(-3.0));
}

TEST(ExposureTrack, LaterFramesFollowTheRecursion) {
  Film film;
  double exposure = film.show(0, 0.0).at(0).point.exposed.exposure;
  for (uint64_t i = 1; i < 20; ++i) {
    const double mean = std::sin(static_cast<double>(i));
    const auto decided = film.show(i, mean);
    ASSERT_EQ(decided.size(), 1u);
    const double next = adapt_exposure(Settings()->exposure().adaptation(),
                                       PreviousExposure{exposure, kFrameNs * 1e-9}, target(mean));
    EXPECT_EQ(decided[0].point.exposed.exposure, next);
    EXPECT_EQ(decided[0].point.before, exposure);
    EXPECT_EQ(decided[0].point.exposed.target, target(mean));
    exposure = next;
  }
}

TEST(ExposureTrack, ACutTakesItsTarget) {
  Film film;
  film.show(0, 0.0);
  const auto decided = film.show(1, 5.0, /*cut=*/true);
  EXPECT_EQ(decided.at(0).point.exposed.exposure, target(5.0));
  EXPECT_TRUE(decided.at(0).point.cut);
}

TEST(ExposureTrack, ARepeatedFrameTakesTheExposureOfItsFirstTimeAndLeavesNoTrace) {
  Film film;
  film.show(0, 0.0);
  const auto first = film.show(1, 3.0);
  EXPECT_EQ(film.show(1, 9.0, /*cut=*/true).at(0).point, first.at(0).point);
  Film plain;
  plain.show(0, 0.0);
  plain.show(1, 3.0);
  EXPECT_EQ(film.show(2, 1.0).at(0).point, plain.show(2, 1.0).at(0).point);
}

TEST(ExposureTrack, RefusesNumbersAndTimesThatRunBackwards) {
  Film film;
  film.show(5, 0.0);
  EXPECT_REFUSED(kInvalidArgument, "frame.sequence is 4 after 5", film.track.add(4, 5 * kFrameNs, false, {}));
  EXPECT_REFUSED(kInvalidArgument, "", film.track.add(6, 5 * kFrameNs - 1, false, {}));
  EXPECT_FALSE(film.track.add(5, 6 * kFrameNs, false, {}).ok());
  EXPECT_FALSE(film.track.add(6, -1, false, {}).ok());
  EXPECT_OK(film.add(6));
}

TEST(ExposureTrack, AFailedFrameTakesNoPartAndPassesItsCutOn) {
  Film film;
  film.show(0, 0.0);
  ASSERT_OK(film.add(1, /*cut=*/true));
  film.track.failed(1);
  EXPECT_TRUE(film.decided().empty());
  const auto decided = film.show(2, 4.0);
  EXPECT_EQ(decided.at(0).point.exposed.exposure, target(4.0));
  EXPECT_FALSE(film.show(3, 4.0).at(0).point.cut);
}

TEST(ExposureTrack, LookaheadWaitsForItsFramesAndWeighsThem) {
  Film film(2);
  EXPECT_TRUE(film.show(0, 1.0).empty());
  EXPECT_TRUE(film.show(1, 2.0).empty());
  const auto decided = film.show(2, 6.0);
  ASSERT_EQ(decided.size(), 1u);
  EXPECT_EQ(decided[0].sequence, 0u);
  EXPECT_EQ(decided[0].point.exposed.target, target((3 * 1.0 + 2 * 2.0 + 6.0) / 6));
  const auto rest = film.ended();
  ASSERT_EQ(rest.size(), 2u);
  EXPECT_EQ(rest[0].point.exposed.target, target((3 * 2.0 + 2 * 6.0) / 5));
  EXPECT_EQ(rest[1].point.exposed.target, target(6.0));
}

TEST(ExposureTrack, LookaheadDoesNotWaitForMoreWhereAFrameFailed) {
  Film film(2);
  EXPECT_TRUE(film.show(0, 1.0).empty());
  for (const uint64_t i : {1u, 2u}) ASSERT_OK(film.add(i));
  film.track.failed(1);
  EXPECT_TRUE(film.decided().empty());
  film.track.metered(2, metered_at(6.0));
  EXPECT_EQ(film.decided().at(0).point.exposed.target, target((3 * 1.0 + 6.0) / 4));
  for (const uint64_t i : {3u, 4u}) ASSERT_OK(film.add(i));
  film.track.failed(4);
  EXPECT_TRUE(film.decided().empty());
  film.track.failed(3);
  EXPECT_EQ(film.decided().at(0).point.exposed.target, target(6.0));
}

TEST(ExposureTrack, LookaheadEndsAtACut) {
  Film film(3);
  EXPECT_TRUE(film.show(0, 1.0).empty());
  ASSERT_OK(film.add(1, /*cut=*/true));  // not even metered
  const auto decided = film.decided();
  ASSERT_EQ(decided.size(), 1u);
  EXPECT_EQ(decided[0].point.exposed.target, target(1.0));
}

// Its picture is not what the next frame is compared with, not even by an earlier frame that looks ahead.
TEST(ExposureTrack, ARepeatsPictureIsNotCompared) {
  const auto first_exposure = [](bool repeat) {
    Film film(2, 1.0);
    film.show(0, 0.0);
    film.show(1, 0.0);
    if (repeat) {
      EXPECT_OK(film.add(1));
      FrameStats other = metered_at(0.0);
      for (size_t i = 0; i < other.print.size(); ++i) other.print[i] = i % 2 == 0 ? 5.0f : -5.0f;
      film.track.metered(1, other);
    }
    const auto decided = film.show(2, 4.0);
    return decided.empty() ? -1.0 : decided[0].point.exposed.exposure;
  };
  EXPECT_GT(first_exposure(false), 0);
  EXPECT_EQ(first_exposure(true), first_exposure(false));
}

TEST(ExposureTrack, ARepeatWithAnotherMediaTimeIsRefused) {
  Film film;
  film.show(1, 0.0);
  for (const int64_t other : {kFrameNs - 1, kFrameNs + 1}) {
    EXPECT_REFUSED(kInvalidArgument, "frame.media_time_ns", film.track.add(1, other, false, film.settings));
  }
  EXPECT_OK(film.add(1));
}

// Its number and time stay; a frame with both is no repeat, but has an exposure of its own.
TEST(ExposureTrack, AFailedFramesNumberMayComeAgain) {
  Film film;
  const double before = film.show(0, 0.0).at(0).point.exposed.exposure;
  ASSERT_OK(film.add(2));
  film.track.failed(2);
  EXPECT_TRUE(film.decided().empty());
  EXPECT_FALSE(film.add(1).ok());
  EXPECT_FALSE(film.track.add(2, 2 * kFrameNs + 1, false, film.settings).ok());
  const auto again = film.show(2, 3.0);
  ASSERT_EQ(again.size(), 1u);
  EXPECT_EQ(
      again[0].point.exposed.exposure,
      adapt_exposure(film.settings.adaptation(), PreviousExposure{before, 2 * kFrameNs * 1e-9}, target(3.0)));
}

// A repeated frame stays a repeat if it sets `cut` or if it fails.
TEST(ExposureTrack, ARepeatBoundsNoLookaheadAndLeavesNoCut) {
  const auto last = [](bool repeat) {
    Film film(2);
    film.show(0, 1.0);
    film.show(1, 2.0, /*cut=*/true);
    if (repeat) film.show(1, 2.0, /*cut=*/true);
    if (repeat && film.add(1, /*cut=*/true).ok()) film.track.failed(1);
    std::vector<FrameExposure> all;
    for (uint64_t i = 2; i < 6; ++i) append(all, film.show(i, static_cast<double>(i)));
    return all.back();
  };
  EXPECT_EQ(last(true).sequence, last(false).sequence);
  EXPECT_EQ(last(true).point, last(false).point);
}

TEST(ExposureTrack, OrderOfMeteringChangesNothing) {
  Film forwards(2);
  Film backwards(2);
  std::vector<FrameExposure> a;
  for (uint64_t i = 0; i < 6; ++i) {
    append(a, forwards.show(i, static_cast<double>(i)));
    ASSERT_OK(backwards.add(i));
  }
  for (uint64_t i = 6; i-- > 0;) backwards.track.metered(i, metered_at(static_cast<double>(i)));
  const std::vector<FrameExposure> b = backwards.decided();
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) EXPECT_EQ(a[i].point, b[i].point);
}

TEST(ExposureTrack, GoesOnFromAnyStateAsIfItHadNotStopped) {
  for (const uint32_t lookahead : {0u, 2u}) {
    Film whole(lookahead, 1.0);
    std::vector<FrameExposure> all;
    const auto mean = [](uint64_t i) { return std::sin(static_cast<double>(i)) * 3; };
    for (uint64_t i = 0; i < 12; ++i) append(all, whole.show(i, mean(i)));
    append(all, whole.ended());
    ASSERT_EQ(all.size(), 12u);
    for (uint64_t stop = 0; stop < 11; ++stop) {
      Film resumed(lookahead, 1.0, all[stop].point);
      std::vector<FrameExposure> rest;
      for (uint64_t i = stop + 1; i < 12; ++i) append(rest, resumed.show(i, mean(i)));
      append(rest, resumed.ended());
      ASSERT_EQ(rest.size(), 11 - stop);
      for (size_t i = 0; i < rest.size(); ++i) EXPECT_EQ(rest[i].point, all[stop + 1 + i].point);
    }
  }
}

TEST(ExposureTrack, DetectsACutByThePictureAndNotByItsBrightness) {
  Film film(0, 1.0);
  film.show(0, 0.0);
  EXPECT_FALSE(film.show(1, 10.0).at(0).point.cut) << "a light went on";
  ASSERT_OK(film.add(2));
  FrameStats other = metered_at(10.0);
  for (size_t i = 0; i < other.print.size(); i += 2) other.print[i] += 4.0f;  // deviation 2 EV
  film.track.metered(2, other);
  const auto decided = film.decided();
  EXPECT_TRUE(decided.at(0).point.cut);
  EXPECT_EQ(decided.at(0).point.exposed.exposure, target(10.0));
}

TEST(ExposureTrack, ManualExposureDoesNotAdapt) {
  Film film;
  film.settings.set_mode(v1::Exposure::MODE_MANUAL);
  film.settings.set_manual_ev(2.0);
  film.show(0, 0.0);
  EXPECT_EQ(film.show(1, 9.0).at(0).point.exposed, (Exposed{4.0, 4.0}));
}

TEST(NothingMetered, KeepsTheExposureAndAddsNoTimeToTheNextFrame) {
  Film film;
  const double kept = film.show(0, 3.0).at(0).point.exposed.exposure;
  for (uint64_t i = 1; i < 4; ++i) {
    const ExposurePoint point = film.show_unmetered(i).at(0).point;
    EXPECT_EQ(point.exposed.exposure, kept);
    EXPECT_EQ(point.before, kept);
    EXPECT_EQ(point.exposed.target, target(std::log2(0.18)));
    EXPECT_FALSE(point.cut || point.cut_pending);
  }
  const double next =
      adapt_exposure(film.settings.adaptation(), PreviousExposure{kept, kFrameNs * 1e-9}, target(-1.0));
  EXPECT_EQ(film.show(4, -1.0).at(0).point.exposed.exposure, next);
}

TEST(NothingMetered, AFirstFrameTakesTheExposureFor018) {
  Film film;
  const ExposurePoint first = film.show_unmetered(0).at(0).point;
  EXPECT_EQ(first.exposed, (Exposed{target(std::log2(0.18)), target(std::log2(0.18))}));
  EXPECT_EQ(film.show(1, 4.0).at(0).point.before, first.exposed.exposure);
}

TEST(NothingMetered, HasNoWeightInTheLookaheadOfOthersAndNoneOfItsOwn) {
  Film film(2);
  EXPECT_TRUE(film.show(0, 1.0).empty());
  EXPECT_TRUE(film.show_unmetered(1).empty());
  const auto decided = film.show(2, 6.0);
  ASSERT_EQ(decided.size(), 2u);
  EXPECT_EQ(decided[0].point.exposed.target, target((3 * 1.0 + 6.0) / 4));
  EXPECT_EQ(decided[1].sequence, 1u);
  EXPECT_EQ(decided[1].point.exposed.exposure, decided[0].point.exposed.exposure);
  EXPECT_TRUE(film.show_unmetered(3).empty());
  const auto rest = film.show_unmetered(4);
  ASSERT_EQ(rest.size(), 3u);
  EXPECT_EQ(rest[0].point.exposed.target, target(6.0));
  EXPECT_EQ(rest[2].point.exposed.exposure, rest[0].point.exposed.exposure);
}

TEST(NothingMetered, PassesItsCutOnToTheNextFrameThatIsMetered) {
  for (const uint32_t lookahead : {0u, 3u}) {
    Film film(lookahead);
    std::vector<FrameExposure> all = film.show(0, 0.0);
    append(all, film.show_unmetered(1, /*cut=*/true));
    EXPECT_EQ(all.size(), 2u) << "the cut ends the look-ahead of frame 0";
    append(all, film.show_unmetered(2));
    append(all, film.show(3, 5.0));
    append(all, film.show(4, 5.0));
    append(all, film.ended());
    ASSERT_EQ(all.size(), 5u);
    EXPECT_EQ(all[0].point.exposed.target, target(0.0));
    for (const size_t i : {1u, 2u}) {
      EXPECT_EQ(all[i].point.exposed.exposure, target(0.0)) << i;
      EXPECT_TRUE(all[i].point.cut_pending) << i;
      EXPECT_EQ(all[i].point.cut, i == 1) << i;
    }
    EXPECT_EQ(all[3].point.exposed.exposure, target(5.0));
    EXPECT_TRUE(all[3].point.cut);
    EXPECT_FALSE(all[4].point.cut || all[4].point.cut_pending);
  }
}

TEST(NothingMetered, IsNoCutAndTheNextFrameIsComparedWithTheLastPicture) {
  for (const uint32_t lookahead : {0u, 2u}) {
    for (const bool other_scene : {false, true}) {
      Film film(lookahead, 1.0);
      std::vector<FrameExposure> all = film.show(0, 0.0);
      append(all, film.show_unmetered(1));
      FrameStats stats = metered_at(2.0);
      for (size_t i = 0; other_scene && i < stats.print.size(); i += 2) stats.print[i] += 4.0f;
      ASSERT_OK(film.add(2));
      film.track.metered(2, stats);
      append(all, film.ended());
      ASSERT_EQ(all.size(), 3u);
      EXPECT_FALSE(all[1].point.cut);
      EXPECT_EQ(all[1].point.print, all[0].point.print);
      EXPECT_EQ(all[2].point.cut, other_scene);
      EXPECT_EQ(all[2].point.print, stats.print);
      const bool weighed = lookahead > 0 && !other_scene;  // frame 2 in the mean of frame 0
      EXPECT_EQ(all[0].point.exposed.target, target(weighed ? 2.0 / 4 : 0.0));
    }
  }
}

TEST(NothingMetered, GoesOnFromItsStateAsIfItHadNotStopped) {
  Film whole(0, 1.0);
  whole.show(0, 3.0);
  const ExposurePoint state = whole.show_unmetered(1, /*cut=*/true).at(0).point;
  Film resumed(0, 1.0, state);
  for (uint64_t i = 2; i < 5; ++i) {
    EXPECT_EQ(resumed.show(i, -2.0 * static_cast<double>(i)).at(0).point,
              whole.show(i, -2.0 * static_cast<double>(i)).at(0).point);
  }
}

TEST(NothingMetered, ManualExposureIsAsEver) {
  Film film;
  film.show(0, 0.0);
  film.settings.set_mode(v1::Exposure::MODE_MANUAL);
  film.settings.set_manual_ev(2.0);
  const ExposurePoint point = film.show_unmetered(1, /*cut=*/true).at(0).point;
  EXPECT_EQ(point.exposed, (Exposed{4.0, 4.0}));
  EXPECT_EQ(point.before, 4.0);
}

// States and given exposures: sessions that continue another one, and frames that bring their exposure.

FrameStats metered_with_picture(double mean_log2_luminance) {
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
  EXPECT_OK(track.add(i, static_cast<int64_t>(i) * kFrameNs, cut, defaults(), given));
  track.metered(i, metered_with_picture(mean));
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
  EXPECT_EQ(next.exposed.exposure,
            adapt_exposure(defaults().adaptation(), PreviousExposure{5.0, kFrameNs * 1e-9}, target_of(2.0)));
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
  EXPECT_FALSE(resumed.add(1, kFrameNs, false, defaults(), 5.0).ok());
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
