// Work that is shared among threads, in a process that the system gives no more threads.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <system_error>
#include <thread>
#include <vector>

#include "server/base/crew.h"
#include "server/render/reference/reference_frame.h"

namespace candela {
namespace {

constexpr uid_t kNobody = 65534;  // the limit does not bind root

// From now on, this process starts no thread.
void refuse_threads() {
  const rlimit none{};
  if (setrlimit(RLIMIT_NPROC, &none) != 0 || (geteuid() == 0 && setuid(kNobody) != 0)) std::_Exit(2);
  try {
    std::thread([] {}).join();
  } catch (const std::system_error&) {
    return;
  }
  std::_Exit(3);
}

TEST(FewThreads, TheCallingThreadDoesTheRowsOfThoseThatDoNotStart) {
  const auto whole = [] {
    refuse_threads();
    std::vector<int> texels(3000 * 7);
    for_row_parts(3000, 7, 4, [&texels](const RowSpan& span, uint32_t) {
      for (uint32_t x = span.first; x < span.last; ++x) ++texels[span.y * 3000 + x];
    });
    std::_Exit(std::all_of(texels.begin(), texels.end(), [](int count) { return count == 1; }) ? 0 : 1);
  };
  EXPECT_EXIT(whole(), ::testing::ExitedWithCode(0), "");
}

TEST(FewThreads, TheCallerOfACrewDoesItsWork) {
  const auto whole = [] {
    refuse_threads();
    Crew crew(4);
    int units = 0;
    crew.run(100, [&units](uint32_t) { ++units; });
    std::_Exit(units == 100 ? 0 : 1);
  };
  EXPECT_EXIT(whole(), ::testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace candela
