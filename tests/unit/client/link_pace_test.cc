#include "client/call/link_pace.h"

#include <gtest/gtest.h>

namespace candela {
namespace {

constexpr uint64_t kBand = 2 << 20;

// Sends a frame of `bands` over a link of so many bytes a second. Returns whether it was compressed.
bool send(LinkPace& pace, double bytes_per_second, uint64_t bands = 8) {
  const bool compressed = pace.next_frame();
  for (uint64_t i = 0; !compressed && i + 1 < bands; ++i) {
    pace.wrote(i, kBand, absl::Seconds(static_cast<double>(kBand) / bytes_per_second));
  }
  return compressed;
}

TEST(LinkPace, CompressesOnALinkOfAGigabitAndNotOnLoopback) {
  LinkPace slow, fast;
  EXPECT_FALSE(send(slow, 117e6));  // nothing is known yet
  for (int i = 0; i < 20; ++i) {
    EXPECT_TRUE(send(slow, 117e6));
    EXPECT_FALSE(send(fast, 600e6));
  }
}

TEST(LinkPace, LooksAgainNowAndThen) {
  LinkPace pace;
  int plain = 0;
  for (int i = 0; i < 650; ++i) plain += send(pace, 10e6) ? 0 : 1;
  EXPECT_EQ(plain, 10);
  // The link becomes fast.
  int compressed = 0;
  for (int i = 0; i < 650; ++i) compressed += send(pace, 900e6) ? 1 : 0;
  EXPECT_LE(compressed, 65);
}

TEST(LinkPace, AServerThatTakesAFrameLateIsNoSlowLink) {
  LinkPace pace;
  for (int i = 0; i < 20; ++i) {
    EXPECT_FALSE(pace.next_frame());
    pace.wrote(0, kBand, absl::Seconds(1));
    pace.wrote(1, kBand, absl::Seconds(1));
    for (uint64_t band = 2; band < 7; ++band) {
      pace.wrote(band, kBand, band == 4 ? absl::Seconds(1) : absl::Milliseconds(3));
    }
  }
}

TEST(LinkPace, FramesOfAFewBandsSayNothing) {
  LinkPace pace;
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(send(pace, 1e6, 4));
}

}  // namespace
}  // namespace candela
