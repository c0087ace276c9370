#include "tests/device/host_fixture.h"

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

}  // namespace candela::testing
