#include "server/schedule/render_loop.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

#include "absl/synchronization/notification.h"

namespace candela {
namespace {

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
    return [this](const FrameJob&) -> absl::StatusOr<FrameReport> {
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
  std::vector<int> order;
  {
    RenderLoop loop([](const FrameJob&) { return FrameReport{}; }, 100);
    for (int i = 0; i < 50; ++i) {
      ASSERT_TRUE(loop.submit(job([&order, i](auto) { order.push_back(i); })).ok());
    }
  }
  ASSERT_EQ(order.size(), 50u);
  for (int i = 0; i < 50; ++i) EXPECT_EQ(order[static_cast<size_t>(i)], i);
}

TEST(RenderLoop, AFullQueueRefusesAndForgetsTheJob) {
  GatedRender render;
  RenderLoop loop(render.function(), 2);
  ASSERT_TRUE(loop.submit(job([](auto) {})).ok());
  render.wait_until_busy();
  ASSERT_TRUE(loop.submit(job([](auto) {})).ok());
  ASSERT_TRUE(loop.submit(job([](auto) {})).ok());
  FrameJob fourth = job([](auto) { ADD_FAILURE() << "a refused job was completed"; });
  const std::weak_ptr<Frame> frame = fourth.frame;
  EXPECT_TRUE(absl::IsUnavailable(loop.submit(std::move(fourth)).status()));
  EXPECT_TRUE(frame.expired());
  render.open();
}

TEST(RenderLoop, ACancelledJobFreesItsFrameAtOnceAndIsNeverCompleted) {
  GatedRender render;
  RenderLoop loop(render.function(), 8);
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
  std::atomic<int> rendered = 0;
  absl::Status status;
  {
    RenderLoop loop(
        [&](const FrameJob&) {
          ++rendered;
          return FrameReport{};
        },
        8);
    FrameJob late = job([&](absl::StatusOr<RenderedFrame> result) { status = result.status(); });
    late.deadline = absl::Now() - absl::Milliseconds(1);
    ASSERT_TRUE(loop.submit(std::move(late)).ok());
  }
  EXPECT_TRUE(absl::IsDeadlineExceeded(status)) << status;
  EXPECT_EQ(rendered, 0);
}

TEST(RenderLoop, ARenderersErrorReachesItsJobAlone) {
  std::vector<absl::StatusCode> codes;
  {
    int count = 0;
    RenderLoop loop(
        [&count](const FrameJob&) -> absl::StatusOr<FrameReport> {
          if (++count == 2) return absl::InvalidArgumentError("bad pixel");
          return FrameReport{};
        },
        8);
    for (int i = 0; i < 3; ++i) {
      ASSERT_TRUE(loop.submit(job([&](auto result) { codes.push_back(result.status().code()); })).ok());
    }
  }
  EXPECT_EQ(codes,
            (std::vector{absl::StatusCode::kOk, absl::StatusCode::kInvalidArgument, absl::StatusCode::kOk}));
}

TEST(RenderLoop, StopFinishesWhatWaitsAndTakesNoMore) {
  int done = 0;
  RenderLoop loop([](const FrameJob&) { return FrameReport{}; }, 100);
  for (int i = 0; i < 20; ++i) ASSERT_TRUE(loop.submit(job([&done](auto) { ++done; })).ok());
  loop.stop();
  EXPECT_EQ(done, 20);
  EXPECT_TRUE(absl::IsUnavailable(loop.submit(job([](auto) {})).status()));
}

}  // namespace
}  // namespace candela
