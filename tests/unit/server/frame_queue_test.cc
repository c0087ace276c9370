// The order in which the queue serves the frames of several flows.
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "server/schedule/render_loop.h"
#include "tests/support/status.h"

namespace candela {
namespace {

FrameJob job_of(Flow flow) {
  FrameJob job;
  job.frame = std::make_shared<Frame>();
  job.frame->sequence = flow;
  job.flow = flow;
  return job;
}

// Serves `frames` frames from flows that always have a frame waiting, with these costs. Returns the device
// time of each flow.
std::map<Flow, absl::Duration> serve(FrameQueue& queue, const std::map<Flow, absl::Duration>& costs,
                                     int frames) {
  std::map<Flow, absl::Duration> used;
  for (const auto& [flow, cost] : costs) {
    EXPECT_OK(queue.push(job_of(flow)));
    EXPECT_OK(queue.push(job_of(flow)));
  }
  for (int i = 0; i < frames; ++i) {
    const std::optional<FrameJob> job = queue.pop();
    queue.charge(job->flow, costs.at(job->flow));
    used[job->flow] += costs.at(job->flow);
    EXPECT_OK(queue.push(job_of(job->flow)));
  }
  return used;
}

TEST(FrameQueue, FramesOfOneFlowKeepTheirOrder) {
  FrameQueue queue(10);
  std::vector<Ticket> tickets;
  for (uint64_t i = 0; i < 5; ++i) {
    FrameJob job = job_of(1);
    job.frame->sequence = i;
    ASSERT_OK(queue.push(std::move(job)));
  }
  for (uint64_t i = 0; i < 5; ++i) EXPECT_EQ(queue.pop()->frame->sequence, i);
  EXPECT_TRUE(queue.empty());
}

TEST(FrameQueue, AHeavyFlowGetsNoMoreOfTheDeviceThanALightOne) {
  FrameQueue queue(100);
  const std::map<Flow, absl::Duration> costs = {{1, absl::Milliseconds(90)},
                                                {2, absl::Milliseconds(10)},
                                                {3, absl::Milliseconds(10)},
                                                {4, absl::Milliseconds(10)}};
  const std::map<Flow, absl::Duration> used = serve(queue, costs, 3000);
  absl::Duration all;
  for (const auto& [flow, time] : used) all += time;
  for (const auto& [flow, time] : used) {
    EXPECT_NEAR(absl::FDivDuration(time, all), 0.25, 0.01) << "flow " << flow;
  }
}

// Both have a frame waiting. What was done for the first one elsewhere counts as two frames.
TEST(FrameQueue, WorkElsewhereCountsAsTimeOfTheDevice) {
  FrameQueue queue(100);
  for (int i = 0; i < 4; ++i) {
    ASSERT_OK(queue.push(job_of(1)));
    ASSERT_OK(queue.push(job_of(2)));
  }
  queue.charge_elsewhere(1, absl::Milliseconds(20));
  std::string order;
  for (int i = 0; i < 5; ++i) {
    const std::optional<FrameJob> job = queue.pop();
    order += std::to_string(job->flow);
    queue.charge(job->flow, absl::Milliseconds(10));
  }
  EXPECT_EQ(order, "21221");  // else "12121"
  // A flow without a job may be charged, and a clock may be set back.
  queue.charge_elsewhere(3, absl::Milliseconds(5));
  queue.charge_elsewhere(3, -absl::Seconds(1));
}

TEST(FrameQueue, AFlowThatPausedHasNoClaimOnWhatItDidNotUse) {
  FrameQueue queue(100);
  serve(queue, {{1, absl::Milliseconds(10)}}, 1000);
  // From now on a new flow, and a flow that returns, take turns with flow 1.
  ASSERT_OK(queue.push(job_of(2)));
  ASSERT_OK(queue.push(job_of(2)));
  int second = 0;
  for (int i = 0; i < 4; ++i) {
    const std::optional<FrameJob> job = queue.pop();
    second += job->flow == 2 ? 1 : 0;
    queue.charge(job->flow, absl::Milliseconds(10));
    ASSERT_OK(queue.push(job_of(job->flow)));
  }
  EXPECT_EQ(second, 2);
}

TEST(FrameQueue, FlowsThatComeForOneFrameDoNotKeepAnotherWaiting) {
  FrameQueue queue(100);
  for (int i = 0; i < 2; ++i) ASSERT_OK(queue.push(job_of(1)));
  Flow newcomer = 2;
  for (int i = 0; i < 2; ++i) ASSERT_OK(queue.push(job_of(newcomer++)));
  std::map<Flow, int> served;
  for (int i = 0; i < 30; ++i) {
    const std::optional<FrameJob> job = queue.pop();
    queue.charge(job->flow, absl::Milliseconds(10));
    const bool is_newcomer = job->flow != 1;
    ++served[is_newcomer ? 2 : 1];
    ASSERT_TRUE(queue.push(job_of(is_newcomer ? newcomer++ : 1)).ok());
  }
  EXPECT_NEAR(served[1], 10, 2) << "of 30 frames, with two others that always wait";
}

TEST(FrameQueue, ASmallFrameDoesNotWaitForASliceOfEachOfManyFlows) {
  FrameQueue queue(100);
  for (Flow flow = 1; flow <= 20; ++flow) ASSERT_OK(queue.push(job_of(flow)));
  const auto slice = [&queue] {
    std::optional<FrameJob> job = queue.pop();
    const Flow flow = job->flow;
    queue.charge(flow, flow == 100 ? absl::Milliseconds(2) : absl::Milliseconds(50));
    if (flow != 100) queue.put_back(*std::move(job));
    return flow;
  };
  for (int i = 0; i < 50; ++i) slice();  // every flow has had a slice
  for (int frame = 0; frame < 10; ++frame) {
    ASSERT_OK(queue.push(job_of(100)));
    EXPECT_EQ(slice(), 100u);
    for (int i = 0; i < 7; ++i) EXPECT_NE(slice(), 100u);
  }
}

// The share of a flow of long jobs beside flows of short ones, each of which comes for one job only.
TEST(FrameQueue, ManySmallFramesDoNotKeepALongJobWaiting) {
  FrameQueue queue(100);
  ASSERT_OK(queue.push(job_of(1)));
  Flow newcomer = 2;
  for (int i = 0; i < 2; ++i) ASSERT_OK(queue.push(job_of(newcomer++)));
  absl::Duration used, all;
  for (int i = 0; i < 1000; ++i) {
    std::optional<FrameJob> job = queue.pop();
    const absl::Duration cost = absl::Milliseconds(job->flow == 1 ? 50 : 5);
    queue.charge(job->flow, cost);
    all += cost;
    if (job->flow == 1) {
      used += cost;
      queue.put_back(*std::move(job));
    } else {
      ASSERT_OK(queue.push(job_of(newcomer++)));
    }
  }
  EXPECT_NEAR(absl::FDivDuration(used, all), 1.0 / 3, 0.05);
}

TEST(FrameQueue, FlowsThatAreDoneAreForgotten) {
  FrameQueue queue(100);
  for (Flow flow = 0; flow < 1000; ++flow) {
    ASSERT_OK(queue.push(job_of(flow)));
    queue.charge(queue.pop()->flow, absl::Milliseconds(10));
  }
  EXPECT_LE(queue.flows(), 2u);
}

TEST(FrameQueue, AJobThatIsPutBackIsTheNextOfItsFlowAndLetsTheOthersGoFirst) {
  FrameQueue queue(4);
  for (const Flow flow : {1, 1, 2, 2}) ASSERT_OK(queue.push(job_of(flow)));
  std::optional<FrameJob> slice = queue.pop();
  const Ticket ticket = slice->ticket;
  ASSERT_EQ(slice->flow, 1u);
  ASSERT_OK(queue.push(job_of(3)));
  queue.charge(1, absl::Milliseconds(50));
  queue.put_back(*std::move(slice));
  EXPECT_EQ(queue.size(), 5u);  // also if its place was taken
  EXPECT_TRUE(absl::IsUnavailable(queue.push(job_of(4)).status()));
  EXPECT_EQ(queue.pop()->flow, 2u);
  queue.charge(2, absl::Milliseconds(100));
  EXPECT_EQ(queue.pop()->flow, 3u);
  queue.charge(3, absl::Milliseconds(100));
  EXPECT_EQ(queue.pop()->ticket, ticket);
}

TEST(FrameQueue, ARemovedJobIsGone) {
  FrameQueue queue(10);
  const Ticket first = *queue.push(job_of(1));
  const Ticket second = *queue.push(job_of(2));
  EXPECT_TRUE(queue.remove(first).has_value());
  EXPECT_FALSE(queue.remove(first).has_value());
  EXPECT_EQ(queue.pop()->flow, 2u);
  EXPECT_FALSE(queue.remove(second).has_value());
  EXPECT_FALSE(queue.pop().has_value());
}

}  // namespace
}  // namespace candela
