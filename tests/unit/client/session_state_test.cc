// What a session knows of its servers, without a call.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "client/session_driver.h"
#include "tests/support/clock/virtual_clock.h"

namespace candela {
namespace {

TEST(SessionState, TellsWhetherItsServersRenderTheSameBits) {
  struct Row {
    std::vector<std::string> bits;  // of each server; "": it does not say
    bool mixed;
  };
  for (const auto& [bits, mixed] :
       {Row{{"aa"}, false}, Row{{"aa", "aa"}, false}, Row{{"aa", "bb"}, true}, Row{{"aa", "bb", "aa"}, true},
        Row{{"aa", ""}, false}, Row{{"", "bb"}, false}, Row{{"aa", "", "aa"}, false},
        Row{{"aa", "", "bb"}, true}}) {
    testing::VirtualClock clock;
    SessionState state({}, "first", clock, [] {});
    EXPECT_FALSE(state.stats().mixed_bits);
    for (const std::string& server : bits) {
      v1::StreamOpened opened;
      opened.set_bits(server);
      state.take_open(opened);
    }
    EXPECT_EQ(state.stats().resumes, bits.size() - 1);
    EXPECT_EQ(state.stats().mixed_bits, mixed) << ::testing::PrintToString(bits);
  }
}

}  // namespace
}  // namespace candela
