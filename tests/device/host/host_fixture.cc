#include "tests/device/host/host_fixture.h"

#include <bit>

#include "server/render/host/targets.h"
// Only after targets.h.
#include <hwy/highway.h>
#include <hwy/targets.h>

namespace candela::testing {

void HostTest::on_each_instruction_set(const std::function<void(const std::string& name)>& test) {
  const int64_t all = hwy::SupportedTargets() & HWY_TARGETS & (HWY_AVX2 | HWY_AVX3 | HWY_NEON);
  ASSERT_NE(all, 0);
  for (int64_t rest = all; rest != 0; rest &= rest - 1) {
    const int64_t target = rest & -rest;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(target);
    test(hwy::TargetName(target));
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

void expect_same_stats(const FrameStats& a, const FrameStats& b, const std::string& what) {
  const auto bits = [](const auto& floats) {
    std::vector<uint32_t> words;
    for (const float v : floats) words.push_back(std::bit_cast<uint32_t>(v));
    return words;
  };
  EXPECT_EQ(std::bit_cast<uint64_t>(a.mean_log2_luminance), std::bit_cast<uint64_t>(b.mean_log2_luminance))
      << what;
  EXPECT_EQ(std::bit_cast<uint32_t>(a.max_luminance), std::bit_cast<uint32_t>(b.max_luminance)) << what;
  EXPECT_EQ(std::bit_cast<uint32_t>(a.min_luminance), std::bit_cast<uint32_t>(b.min_luminance)) << what;
  EXPECT_EQ(a.metered_weight, b.metered_weight) << what;
  EXPECT_EQ(a.nan_components, b.nan_components) << what;
  EXPECT_EQ(a.infinite_components, b.infinite_components) << what;
  EXPECT_EQ(a.clamped_components, b.clamped_components) << what;
  EXPECT_EQ(a.negative_components, b.negative_components) << what;
  EXPECT_EQ(a.negative_scene_components, b.negative_scene_components) << what;
  EXPECT_EQ(a.absent_pixels, b.absent_pixels) << what;
  EXPECT_EQ(bits(a.tile_light), bits(b.tile_light)) << what;
  EXPECT_EQ(bits(a.print), bits(b.print)) << what;
  EXPECT_EQ(a.histogram, b.histogram) << what;
}

}  // namespace candela::testing
