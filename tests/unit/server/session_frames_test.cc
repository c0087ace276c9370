// The frames of a session: their order, their stages, and the frames that remain if it ends early.
#include "server/session/session_frames.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "tests/support/status.h"

namespace candela {
namespace {

using Entry = SessionFrames::Entry;
using Stage = SessionFrames::Stage;

RenderedFrame rendered_frame(double mean_log2_luminance = 0.0) {
  RenderedFrame frame{{}, absl::Milliseconds(1)};
  frame.report.stats.mean_log2_luminance = mean_log2_luminance;
  frame.report.stats.metered_weight = 1;
  frame.report.stages = {{"ingest", 1}};
  return frame;
}

std::vector<uint64_t> numbers(const SessionFrames::Entries& entries) {
  std::vector<uint64_t> all;
  for (const SessionFrames::EntryPtr& entry : entries) all.push_back(entry->sequence);
  return all;
}

// A session with frames numbered from 0. A frame's number is also its media time in seconds.
class Line {
 public:
  explicit Line(uint32_t lookahead = 0, const ExposurePoint& point = {}, bool draws = true)
      : frames(lookahead, 0.0, point, 4, draws), work_(frames.first_work()) {}

  SessionFrames::EntryPtr receive(uint64_t sequence, bool cut = false, uint32_t timeout_ms = 0) {
    v1::FrameHeader header;
    header.set_sequence(sequence);
    header.set_media_time_ns(static_cast<int64_t>(sequence) * 1'000'000'000);
    header.set_cut(cut);
    header.set_timeout_ms(timeout_ms);
    EXPECT_OK(frames.add(header, {{2, 2, v1::PIXEL_FORMAT_RGBA16F}, v1::PIXEL_FORMAT_RGBA16F, 16}, settings,
                         "hash", now));
    return frames.newest();
  }
  // Receives a frame and submits its first job.
  SessionFrames::EntryPtr queue(uint64_t sequence, bool cut = false) {
    SessionFrames::EntryPtr entry = receive(sequence, cut);
    SessionFrames::submitted(*entry, work_, ++tickets_);
    return entry;
  }
  // Ends the first job of a frame without look-ahead.
  void render(Entry& entry, double mean = 0.0) {
    frames.decide(entry, rendered_frame(mean).report.stats);
    SessionFrames::rendered(entry, rendered_frame(mean), false);
  }
  // Submits every decided frame and returns their numbers.
  std::vector<uint64_t> draw() {
    std::vector<uint64_t> drawn;
    while (const SessionFrames::EntryPtr entry = frames.next_decided()) {
      SessionFrames::submitted(*entry, Work::kDraw, ++tickets_);
      drawn.push_back(entry->sequence);
    }
    return drawn;
  }

  const absl::Time now = absl::UnixEpoch();
  const v1::Exposure settings = Settings()->exposure();
  SessionFrames frames;

 private:
  const Work work_;
  Ticket tickets_ = 0;
};

TEST(SessionFrames, AnswersAreDueInTheOrderOfTheFrames) {
  Line line;
  const auto first = line.queue(0);
  const auto second = line.queue(1);
  EXPECT_EQ(line.frames.due(), nullptr);
  line.frames.decide(*first, rendered_frame().report.stats);
  line.render(*second);
  EXPECT_EQ(line.frames.due(), nullptr) << "the second frame overtook the first";
  SessionFrames::rendered(*first, rendered_frame(), false);
  EXPECT_EQ(line.frames.due(), first);
  line.frames.pop();
  EXPECT_EQ(line.frames.due(), second);
  line.frames.pop();
  EXPECT_TRUE(line.frames.empty());
  EXPECT_EQ(line.frames.answered(), 2u);
}

TEST(SessionFrames, AFrameIsDecidedBetweenItsPhasesByWhatWasMetered) {
  Line line;
  const auto first = line.queue(0);
  const Exposed exposed = line.frames.decide(*first, rendered_frame(3.0).report.stats);
  EXPECT_EQ(exposed.exposure, exposure_target(line.settings, 3.0));
  EXPECT_TRUE(first->decided);
  EXPECT_EQ(first->exposure.exposed, exposed);
  const auto second = line.queue(1);
  line.frames.decide(*second, rendered_frame(-3.0).report.stats);
  EXPECT_EQ(second->exposure.before, exposed.exposure);
}

TEST(SessionFrames, AnEncodedFrameIsDueOnceItsFileIsThere) {
  Line line;
  const auto entry = line.queue(0);
  line.frames.decide(*entry, {});
  SessionFrames::rendered(*entry, rendered_frame(), true);
  EXPECT_EQ(line.frames.due(), nullptr);
  EXPECT_TRUE(entry->unfinished());
  SessionFrames::encoded(*entry, "file", absl::Nanoseconds(5));
  EXPECT_EQ(line.frames.due(), entry);
  EXPECT_FALSE(entry->unfinished());
  EXPECT_EQ(*entry->file, "file");
  ASSERT_EQ(entry->report->stages.size(), 2u);
  EXPECT_EQ(entry->report->stages[1].ns, 5u);
}

TEST(SessionFrames, LookAheadHoldsAFrameBackUntilLaterOnesAreMetered) {
  Line line(2);
  const auto first = line.queue(0);
  const auto second = line.queue(1);
  const auto third = line.queue(2);
  line.frames.metered(*first, rendered_frame(1.0));
  line.frames.metered(*third, rendered_frame(6.0));
  EXPECT_TRUE(line.draw().empty());
  line.frames.metered(*second, rendered_frame(2.0));
  EXPECT_EQ(line.draw(), std::vector<uint64_t>{0});
  EXPECT_EQ(first->exposure.exposed.target, exposure_target(line.settings, (3 * 1.0 + 2 * 2.0 + 6.0) / 6));
  line.frames.close();
  EXPECT_EQ(line.draw(), (std::vector<uint64_t>{1, 2}));
  SessionFrames::rendered(*first, rendered_frame(), false);
  EXPECT_EQ(first->queued, absl::Milliseconds(2)) << "both jobs waited";
  EXPECT_EQ(first->report->stages.size(), 2u) << "the stages of both jobs";
}

TEST(SessionFrames, WithoutImagesAFrameIsDoneOnceItIsDecided) {
  for (const uint32_t lookahead : {0u, 1u}) {
    Line line(lookahead, {}, /*draws=*/false);
    EXPECT_EQ(line.frames.first_work(), Work::kMeter);
    const auto first = line.queue(0);
    const auto second = line.queue(1);
    line.frames.metered(*first, rendered_frame(1.0));
    EXPECT_EQ(line.frames.next_decided(), lookahead == 0 ? first : nullptr);
    line.frames.metered(*second, rendered_frame(2.0));
    line.frames.close();
    while (line.frames.next_decided() != nullptr) continue;
    for (const auto& [entry, mean] : {std::pair(first, 1.0), std::pair(second, 2.0)}) {
      ASSERT_EQ(line.frames.due(), entry);
      EXPECT_EQ(entry->report->stats.mean_log2_luminance, mean);
      EXPECT_EQ(entry->report->exposure, entry->exposure.exposed.exposure);
      EXPECT_EQ(entry->report->target, entry->exposure.exposed.target);
      EXPECT_EQ(entry->report->stages.size(), 1u);
      EXPECT_EQ(entry->report->plan.words.back(), "no image: the encoding is NONE");
      EXPECT_EQ(line.frames.answer(*entry), entry->exposure);
      line.frames.pop();
    }
  }
}

TEST(SessionFrames, ADecidedFrameWaitsUntilItsJobIsSubmitted) {
  Line line(1);
  const auto entry = line.queue(0);
  line.frames.metered(*entry, rendered_frame());
  line.frames.close();
  ASSERT_EQ(line.frames.next_decided(), entry);
  // The render loop refused the job: the session ends, and the frame must not be left behind.
  EXPECT_EQ(numbers(line.frames.end_before(*entry)), std::vector<uint64_t>{0});
  EXPECT_TRUE(entry->unfinished());
}

TEST(SessionFrames, ABadFrameFailsAloneAndItsCutMovesOn) {
  Line line;
  const auto bad = line.queue(0, /*cut=*/true);
  const auto good = line.queue(1);
  EXPECT_TRUE(line.frames.fail(*bad, absl::InvalidArgumentError("a bad pixel")));
  EXPECT_EQ(line.frames.due(), bad);
  EXPECT_TRUE(line.frames.answer(*bad).cut_pending);
  line.frames.pop();
  line.render(*good);
  EXPECT_TRUE(good->exposure.cut);
  const ExposurePoint& point = line.frames.answer(*good);
  EXPECT_FALSE(point.cut_pending);
  EXPECT_EQ(point, good->exposure);
}

TEST(SessionFrames, ARepeatedFrameThatFailsLeavesNoCut) {
  Line line;
  const auto first = line.queue(0, /*cut=*/true);
  line.render(*first);
  line.frames.answer(*line.frames.due());
  line.frames.pop();
  const auto repeated = line.queue(0, /*cut=*/true);
  EXPECT_TRUE(line.frames.fail(*repeated, absl::DeadlineExceededError("late")));
  EXPECT_FALSE(line.frames.answer(*repeated).cut_pending);
}

TEST(SessionFrames, OtherErrorsAndErrorsAfterTheDecisionEndTheSession) {
  Line line;
  const auto entry = line.queue(0);
  EXPECT_FALSE(line.frames.fail(*entry, absl::UnavailableError("device lost")));
  EXPECT_EQ(entry->stage, Stage::kQueued);
  line.frames.decide(*entry, {});
  EXPECT_FALSE(line.frames.fail(*entry, absl::InvalidArgumentError("too late to fail alone")));
}

TEST(SessionFrames, AFailedFrameDoesNotHoldUpLookAhead) {
  Line line(1);
  const auto first = line.queue(0);
  const auto bad = line.queue(1);
  line.frames.metered(*first, rendered_frame(1.0));
  EXPECT_TRUE(line.draw().empty());
  EXPECT_TRUE(line.frames.fail(*bad, absl::InvalidArgumentError("a bad pixel")));
  EXPECT_EQ(line.draw(), std::vector<uint64_t>{0});
  EXPECT_EQ(first->exposure.exposed.target, exposure_target(line.settings, 1.0));
}

TEST(SessionFrames, AFrameIsDecidedWhileTheNextOneArrives) {
  Line alone, together;
  SessionFrames::EntryPtr entry = together.queue(0);
  for (uint64_t sequence = 0; sequence < 100; ++sequence) {
    const auto stats = rendered_frame(static_cast<double>(sequence % 7)).report.stats;
    const Exposed expected = alone.frames.decide(*alone.queue(sequence), stats);
    std::thread render_thread([&, frame = entry] { together.frames.decide(*frame, stats); });
    const auto next = together.queue(sequence + 1);
    render_thread.join();
    EXPECT_EQ(entry->exposure.exposed, expected) << sequence;
    entry = next;
  }
}

TEST(SessionFrames, EndingEarlyKeepsTheFramesBefore) {
  Line line;
  const auto first = line.queue(0);
  const auto lost = line.queue(1);
  const auto third = line.queue(2);
  SessionFrames::rendered(*third, rendered_frame(), false);
  EXPECT_EQ(numbers(line.frames.end_before(*lost)), (std::vector<uint64_t>{1, 2}));
  EXPECT_FALSE(first->dropped);
  EXPECT_TRUE(lost->dropped && lost->submitted() && lost->unfinished());
  EXPECT_TRUE(third->dropped && !third->unfinished());
  EXPECT_EQ(line.frames.decide(*lost, rendered_frame(5.0).report.stats), Exposed());
  EXPECT_FALSE(lost->decided) << "a dropped frame took part in the exposure";
  line.render(*first);
  EXPECT_EQ(line.frames.due(), first);
}

TEST(SessionFrames, EndingAfterTheReceivedFramesDropsTheOneThatIsArriving) {
  Line line;
  line.queue(0);
  EXPECT_TRUE(line.frames.end_after_received().empty());
  const auto arriving = line.receive(1);
  EXPECT_FALSE(arriving->submitted());
  EXPECT_EQ(numbers(line.frames.end_after_received()), std::vector<uint64_t>{1});
  EXPECT_TRUE(arriving->unfinished());
}

TEST(SessionFrames, EndingWithLookAheadDropsWhatIsUndecided) {
  Line line(1);
  const auto decided = line.queue(0);
  const auto waiting = line.queue(1);
  const auto queued = line.queue(2);
  line.frames.metered(*decided, rendered_frame());
  line.frames.metered(*waiting, rendered_frame());
  EXPECT_EQ(line.draw(), std::vector<uint64_t>{0});
  EXPECT_EQ(numbers(line.frames.end_after_received()), (std::vector<uint64_t>{1, 2}));
  EXPECT_FALSE(waiting->submitted());
  EXPECT_TRUE(queued->submitted());
  EXPECT_FALSE(decided->dropped);
  EXPECT_EQ(numbers(line.frames.drop_all()), std::vector<uint64_t>{0});
}

TEST(SessionFrames, EndingWithLookAheadDropsFramesThatAreNotMeteredYet) {
  Line line(1);
  line.queue(0);
  line.queue(1);
  EXPECT_EQ(numbers(line.frames.end_after_received()), (std::vector<uint64_t>{0, 1}));
}

TEST(SessionFrames, ARepeatedFrameIsDecidedAfterTheFrameThatItRepeats) {
  Line line(1);
  const auto first = line.queue(0);
  const auto repeat = line.queue(0);
  const auto next = line.queue(1);
  for (const auto& entry : {first, repeat, next}) line.frames.metered(*entry, rendered_frame());
  ASSERT_EQ(line.frames.next_decided(), first);
  SessionFrames::submitted(*first, Work::kDraw, 9);
  EXPECT_EQ(line.frames.next_decided(), repeat);
}

TEST(SessionFrames, ThereIsRoomForTheLookAheadToo) {
  Line line(2);
  for (uint64_t i = 0; i < 6; ++i) {
    EXPECT_TRUE(line.frames.has_room()) << i;
    line.receive(i);
  }
  EXPECT_FALSE(line.frames.has_room());
}

TEST(SessionFrames, FramesThatArriveOrWaitForOthersAreNotBusy) {
  Line line(1);
  const auto entry = line.receive(0);
  EXPECT_FALSE(line.frames.busy());
  SessionFrames::submitted(*entry, Work::kMeter, 1);
  EXPECT_TRUE(line.frames.busy());
  line.frames.metered(*entry, rendered_frame());
  EXPECT_FALSE(line.frames.busy());
  line.frames.close();
  line.draw();
  EXPECT_TRUE(line.frames.busy());
}

TEST(SessionFrames, AFailedFrameBehindOneThatWaitsIsNotBusy) {
  Line line(2);
  line.frames.metered(*line.queue(0), rendered_frame());
  EXPECT_TRUE(line.frames.fail(*line.queue(1), absl::InvalidArgumentError("bad")));
  EXPECT_EQ(line.draw(), std::vector<uint64_t>{});
  EXPECT_FALSE(line.frames.busy());
  line.frames.close();
  EXPECT_EQ(line.draw(), std::vector<uint64_t>{0});
  EXPECT_TRUE(line.frames.busy());
}

TEST(SessionFrames, AResumedSessionContinuesItsExposure) {
  const ExposurePoint point{
      .begun = true, .sequence = 4, .media_time_ns = 4'000'000'000, .exposed = {8.0, 8.0}, .print = {}};
  Line line(0, point);
  v1::FrameHeader earlier;
  earlier.set_sequence(3);
  EXPECT_TRUE(absl::IsInvalidArgument(line.frames.add(earlier, {}, line.settings, "hash", line.now)));
  const auto entry = line.queue(5);
  line.render(*entry);
  EXPECT_EQ(entry->exposure.before, 8.0);
  EXPECT_EQ(line.frames.answer(*entry), entry->exposure);
}

TEST(SessionFrames, DeadlinesBeginWithTheHeader) {
  Line line;
  EXPECT_EQ(line.receive(0)->deadline, absl::InfiniteFuture());
  EXPECT_EQ(line.receive(1, false, 250)->deadline, line.now + absl::Milliseconds(250));
}

}  // namespace
}  // namespace candela
