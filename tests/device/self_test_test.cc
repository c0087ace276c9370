// The self-test passes on a correct device and refuses a wrong image.
#include "server/render/self_test.h"

#include <gtest/gtest.h>

#include <cstring>

#include "tests/support/device_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

using SelfTest = DeviceTest;

TEST_F(SelfTest, RendersAFrameAndPasses) {
  const PoolCounters before = pool().counters();
  ASSERT_OK_AND_ASSIGN(const std::string digest, self_test(renderer()));
  const PoolCounters after = pool().counters();
  EXPECT_GT(after.hits + after.misses, before.hits + before.misses);
  EXPECT_EQ(digest.size(), 64u);
  // Also where the memory holds another frame.
  ASSERT_OK_AND_ASSIGN(const auto other, render(natural(131, 37), {}));
  ASSERT_OK_AND_ASSIGN(const std::string again, self_test(renderer()));
  EXPECT_EQ(again, digest);
}

TEST_F(SelfTest, SeesOneWrongPixel) {
  ASSERT_OK_AND_ASSIGN(auto rendered, render(natural(67, 35), {}));
  EXPECT_OK(hold_to_reference(rendered.memory, rendered.report));
  // The device rendered this texel differently from the reference.
  rendered.memory.input_row(20)[5 * 8 + 1] ^= std::byte{0x08};
  const absl::Status status = hold_to_reference(rendered.memory, rendered.report);
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
}

TEST_F(SelfTest, SeesWrongStatistics) {
  ASSERT_OK_AND_ASSIGN(auto rendered, render(natural(67, 35), {}));
  FrameReport metered_wrong = rendered.report;
  metered_wrong.stats.mean_log2_luminance += 1e-4;
  EXPECT_FALSE(hold_to_reference(rendered.memory, metered_wrong).ok());
  FrameReport counted_wrong = rendered.report;
  ++counted_wrong.stats.negative_components;
  EXPECT_FALSE(hold_to_reference(rendered.memory, counted_wrong).ok());
}

}  // namespace
}  // namespace candela::testing
