#include "server/schedule/render_loop.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

#include "absl/synchronization/notification.h"
#include "tests/support/clock.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using testing::VirtualClock;

FrameJob job(std::function<void(absl::StatusOr<RenderedFrame>)> done) {
  FrameJob result;
  result.frame = std::make_shared<Frame>();
  result.done = std::move(done);
  return result;
}

// A job that renders nothing and waits until the test lets it run.
class GatedRender {
 public:
  RenderLoop::Render function() {
    return [this](const FrameJob& job) -> absl::StatusOr<FrameReport> {
      if (job.task) return run_job(job);
      ++begun_;
      open_.WaitForNotification();
      return FrameReport{};
    };
  }
  void open() { open_.Notify(); }
  void wait_until_busy() {
    while (begun_ == 0) std::this_thread::yield();
  }

 private:
  std::atomic<int> begun_ = 0;
  absl::Notification open_;
};

TEST(RenderLoop, RendersInTheOrderOfSubmission) {
  VirtualClock clock;
  std::vector<int> order;
  {
    RenderLoop loop([](const FrameJob&) { return FrameReport{}; }, 100, clock);
    for (int i = 0; i < 50; ++i) {
      ASSERT_OK(loop.submit(job([&order, i](auto) { order.push_back(i); })));
    }
  }
  ASSERT_EQ(order.size(), 50u);
  for (int i = 0; i < 50; ++i) EXPECT_EQ(order[static_cast<size_t>(i)], i);
}

TEST(RenderLoop, AFullQueueRefusesAndForgetsTheJob) {
  VirtualClock clock;
  GatedRender render;
  RenderLoop loop(render.function(), 2, clock);
  ASSERT_OK(loop.submit(job([](auto) {})));
  render.wait_until_busy();
  ASSERT_OK(loop.submit(job([](auto) {})));
  ASSERT_OK(loop.submit(job([](auto) {})));
  FrameJob fourth = job([](auto) { ADD_FAILURE() << "a refused job was completed"; });
  const std::weak_ptr<Frame> frame = fourth.frame;
  EXPECT_TRUE(absl::IsUnavailable(loop.submit(std::move(fourth)).status()));
  EXPECT_TRUE(frame.expired());
  render.open();
}

TEST(RenderLoop, ACancelledJobFreesItsFrameAtOnceAndIsNeverCompleted) {
  VirtualClock clock;
  GatedRender render;
  RenderLoop loop(render.function(), 8, clock);
  const absl::StatusOr<Ticket> busy = loop.submit(job([](auto) {}));
  render.wait_until_busy();
  FrameJob waiting = job([](auto) { ADD_FAILURE() << "a cancelled job was completed"; });
  const std::weak_ptr<Frame> frame = waiting.frame;
  const absl::StatusOr<Ticket> ticket = loop.submit(std::move(waiting));
  EXPECT_FALSE(frame.expired());
  EXPECT_TRUE(loop.cancel(*ticket));
  EXPECT_TRUE(frame.expired());
  EXPECT_FALSE(loop.cancel(*ticket));
  EXPECT_FALSE(loop.cancel(*busy));  // it has begun
  render.open();
}

TEST(RenderLoop, AJobPastItsDeadlineIsDroppedWithItsReason) {
  VirtualClock clock;
  std::atomic<int> rendered = 0;
  absl::Status status;
  {
    RenderLoop loop(
        [&](const FrameJob&) {
          ++rendered;
          return FrameReport{};
        },
        8, clock);
    FrameJob late = job([&](absl::StatusOr<RenderedFrame> result) { status = result.status(); });
    late.deadline = clock.now() - absl::Milliseconds(1);
    ASSERT_OK(loop.submit(std::move(late)));
  }
  EXPECT_REFUSED(kDeadlineExceeded, "", status);
  EXPECT_EQ(rendered, 0);
}

TEST(RenderLoop, ARenderersErrorReachesItsJobAlone) {
  VirtualClock clock;
  std::vector<absl::StatusCode> codes;
  {
    int count = 0;
    RenderLoop loop(
        [&count](const FrameJob&) -> absl::StatusOr<FrameReport> {
          if (++count == 2) return absl::InvalidArgumentError("bad pixel");
          return FrameReport{};
        },
        8, clock);
    for (int i = 0; i < 3; ++i) {
      ASSERT_OK(loop.submit(job([&](auto result) { codes.push_back(result.status().code()); })));
    }
  }
  EXPECT_EQ(codes,
            (std::vector{absl::StatusCode::kOk, absl::StatusCode::kInvalidArgument, absl::StatusCode::kOk}));
}

TEST(RenderLoop, StopFinishesWhatWaitsAndTakesNoMore) {
  VirtualClock clock;
  int done = 0;
  RenderLoop loop([](const FrameJob&) { return FrameReport{}; }, 100, clock);
  for (int i = 0; i < 20; ++i) ASSERT_OK(loop.submit(job([&done](auto) { ++done; })));
  loop.stop();
  EXPECT_EQ(done, 20);
  EXPECT_TRUE(absl::IsUnavailable(loop.submit(job([](auto) {})).status()));
}

// A job that takes `slices` slices and says in `order` when each ends.
FrameJob long_job(VirtualClock& clock, Flow flow, int slices, std::vector<Flow>& order) {
  FrameJob result;
  result.flow = flow;
  result.task = [&clock, flow, slices, &order] {
    for (int i = 0; i < slices; ++i) {
      order.push_back(flow);
      clock.advance(absl::Milliseconds(2));
      checkpoint();
    }
    return absl::OkStatus();
  };
  result.done = [](auto) {};
  return result;
}

// Submits the jobs while the loop is busy, so that all of them wait when it is done with that.
void submit_together(RenderLoop& loop, GatedRender& render, std::vector<FrameJob> jobs) {
  ASSERT_OK(loop.submit(job([](auto) {})));
  render.wait_until_busy();
  for (FrameJob& each : jobs) ASSERT_OK(loop.submit(std::move(each)));
  render.open();
}

TEST(RenderLoop, SlicesOfTwoFlowsAlternate) {
  VirtualClock clock;
  std::vector<Flow> order;
  GatedRender render;
  RenderLoop loop(render.function(), 8, clock, absl::ZeroDuration());
  std::vector<FrameJob> jobs;
  jobs.push_back(long_job(clock, 1, 20, order));
  jobs.push_back(long_job(clock, 2, 20, order));
  submit_together(loop, render, std::move(jobs));
  loop.stop();
  ASSERT_EQ(order.size(), 40u);
  for (size_t i = 0; i + 1 < order.size(); ++i) EXPECT_NE(order[i], order[i + 1]) << i;
}

TEST(RenderLoop, AJobInSlicesKeepsItsPlaceAheadOfItsFlowsNextJob) {
  VirtualClock clock;
  std::vector<Flow> order;
  GatedRender render;
  RenderLoop loop(
      [gated = render.function()](const FrameJob& each) {
        for (int i = 0; i < 5; ++i) checkpoint();
        return gated(each);
      },
      8, clock, absl::ZeroDuration());
  std::vector<FrameJob> jobs;
  FrameJob first = job([&order](auto) { order.push_back(1); });
  first.flow = 1;
  first.in_slices = true;
  FrameJob next = job([&order](auto) { order.push_back(2); });
  next.flow = 1;
  jobs.push_back(std::move(first));
  jobs.push_back(std::move(next));
  submit_together(loop, render, std::move(jobs));
  loop.stop();
  EXPECT_EQ(order, (std::vector<Flow>{1, 2}));
}

// All clients of a unix: socket are one flow.
TEST(RenderLoop, AJobInSlicesLetsItsFlowsOtherCallsGoInBetween) {
  VirtualClock clock;
  std::vector<Flow> order;
  GatedRender render;
  RenderLoop loop(render.function(), 8, clock, absl::ZeroDuration());
  std::vector<FrameJob> jobs;
  jobs.push_back(long_job(clock, 1, 5, order));
  FrameJob small = job([&order](auto) { order.push_back(100); });
  small.flow = 1;
  small.ordered = false;
  jobs.push_back(std::move(small));
  submit_together(loop, render, std::move(jobs));
  loop.stop();
  EXPECT_EQ(order, (std::vector<Flow>{1, 100, 1, 1, 1, 1}));
}

TEST(RenderLoop, ATaskOfTheHeartbeatRunsBetweenSlices) {
  VirtualClock clock;
  std::vector<Flow> order;
  GatedRender render;
  RenderLoop loop(render.function(), 8, clock, absl::ZeroDuration());
  std::vector<FrameJob> jobs;
  jobs.push_back(long_job(clock, 1, 50, order));
  submit_together(loop, render, std::move(jobs));
  absl::Notification beat;
  ASSERT_OK(loop.post([&] {
    order.push_back(100);
    beat.Notify();
  }));
  beat.WaitForNotification();
  loop.stop();
  EXPECT_NE(order.back(), 100u) << "the beat waited for the end of the job";
}

TEST(RenderLoop, AFrameInSlicesIsRenderedAndItsPausesCountAsWaiting) {
  VirtualClock clock;
  GatedRender render;
  RenderLoop loop(
      [&, gated = render.function()](const FrameJob& each) -> absl::StatusOr<FrameReport> {
        if (each.work != Work::kDraw) return gated(each);
        for (int i = 0; i < 5; ++i) {
          clock.advance(absl::Milliseconds(10));
          checkpoint();
        }
        FrameReport report;
        report.exposure = 7;
        return report;
      },
      8, clock, absl::ZeroDuration());
  absl::StatusOr<RenderedFrame> result;
  FrameJob frame = job([&](absl::StatusOr<RenderedFrame> rendered) { result = std::move(rendered); });
  frame.in_slices = true;
  frame.work = Work::kDraw;
  frame.flow = 1;
  std::vector<Flow> order;
  std::vector<FrameJob> jobs;
  jobs.push_back(std::move(frame));
  jobs.push_back(long_job(clock, 2, 3, order));  // takes 6 ms in between
  submit_together(loop, render, std::move(jobs));
  loop.stop();
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->report.exposure, 7);
  EXPECT_EQ(result->queued, absl::Milliseconds(6));
}

TEST(RenderLoop, AJobCancelledBetweenSlicesReleasesWhatItHoldsAtOnce) {
  VirtualClock clock;
  const auto held = std::make_shared<int>();
  std::atomic<int> slices = 0;
  GatedRender render;
  RenderLoop loop(render.function(), 8, clock, absl::ZeroDuration());
  FrameJob endless;
  endless.flow = 2;
  endless.task = [copy = held, &clock, &slices]() -> absl::Status {
    for (;; ++slices, clock.advance(absl::Milliseconds(1))) checkpoint();
  };
  endless.done = [](auto) { ADD_FAILURE() << "a cancelled job was completed"; };
  const absl::StatusOr<Ticket> ticket = loop.submit(std::move(endless));
  while (slices == 0) std::this_thread::yield();
  ASSERT_OK(loop.submit(job([](auto) {})));  // occupies the thread
  render.wait_until_busy();
  EXPECT_EQ(loop.waiting(), 1u);
  EXPECT_TRUE(loop.cancel(*ticket));
  EXPECT_EQ(held.use_count(), 1);
  EXPECT_EQ(loop.waiting(), 0u);
  render.open();
}

TEST(RenderLoop, AJobCancelledDuringASliceEndsWithIt) {
  VirtualClock clock;
  absl::Notification begun, cancelled, done;
  absl::Status status;
  RenderLoop loop(run_job, 8, clock, absl::ZeroDuration());
  FrameJob endless;
  endless.task = [&]() -> absl::Status {
    begun.Notify();
    cancelled.WaitForNotification();
    for (;;) checkpoint();
  };
  endless.done = [&](absl::StatusOr<RenderedFrame> result) {
    status = result.status();
    done.Notify();
  };
  const absl::StatusOr<Ticket> ticket = loop.submit(std::move(endless));
  begun.WaitForNotification();
  EXPECT_FALSE(loop.cancel(*ticket));
  cancelled.Notify();
  done.WaitForNotification();
  EXPECT_REFUSED(kCancelled, "", status);
}

TEST(RenderLoop, AJobThatHasBegunIsFinishedAfterItsDeadline) {
  VirtualClock clock;
  absl::Notification done;
  absl::Status status = absl::UnknownError("not done");
  RenderLoop loop(run_job, 8, clock, absl::ZeroDuration());
  FrameJob late;
  late.deadline = clock.now() + absl::Milliseconds(500);
  late.task = [&clock] {
    for (int i = 0; i < 6; ++i) {
      clock.advance(absl::Milliseconds(100));
      checkpoint();
    }
    return absl::OkStatus();
  };
  late.done = [&](absl::StatusOr<RenderedFrame> result) {
    status = result.status();
    done.Notify();
  };
  ASSERT_OK(loop.submit(std::move(late)));
  done.WaitForNotification();
  EXPECT_OK(status);
}

}  // namespace
}  // namespace candela
