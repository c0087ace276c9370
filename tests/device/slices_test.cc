// The reference in slices: as many as it has rows, and the same bits.
#include "server/base/slices.h"

#include <cstring>
#include <optional>

#include "absl/time/clock.h"
#include "tests/support/device_fixture.h"

namespace candela::testing {
namespace {

struct Case {
  const char* name;
  uint32_t width;
  uint32_t height;
  v1::Settings settings;
};

std::vector<Case> cases() {
  std::vector<Case> all(4);
  all[0] = {"verified", 640, 360, {}};
  all[1] = {"by the reference", 640, 360, {}};
  all[1].settings.set_tier("reference");
  all[2] = {"gaussian bloom", 640, 360, {}};
  all[2].settings.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
  all[3] = {"rows of 16384, aces-1", 16384, 24, {}};
  all[3].settings.set_curve(v1::TONE_CURVE_ACES_1);
  return all;
}

class Slices : public DeviceTest {};

TEST_F(Slices, TheReferenceCanPauseAtEveryRowAndItsResultsAreTheSame) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const WireFrame frame = natural(c.width, c.height);
    const auto render_it = [&] { return render(frame, c.settings, {}, Verify::kWithMap); };
    const absl::StatusOr<Rendered> whole = render_it();
    std::optional<absl::StatusOr<Rendered>> sliced;
    SlicedWork work([&] { sliced = render_it(); });
    int slices = 1;
    const absl::Time begin = absl::Now();
    absl::Duration longest;
    for (bool ended = false; !ended; ++slices) {
      const absl::Time start = absl::Now();
      ended = work.run(absl::ZeroDuration());
      // The first one holds what the device does.
      if (slices > 1) longest = std::max(longest, absl::Now() - start);
    }
    ASSERT_TRUE(whole.ok() && (*sliced).ok()) << whole.status() << (*sliced).status();
    std::cout << c.name << ": " << slices << " slices, the longest " << longest << " of "
              << absl::Now() - begin << "\n";
    // Ingest, metering, and the comparison, which uses several threads.
    EXPECT_GE(slices, 2 * static_cast<int>(c.height));
    EXPECT_EQ(image(whole->memory), image((*sliced)->memory));
    const Verification& a = whole->report.verification->rounded;
    const Verification& b = (*sliced)->report.verification->rounded;
    EXPECT_EQ(std::memcmp(&a.max_codes, &b.max_codes, sizeof a.max_codes), 0);
    EXPECT_EQ(a.mean_codes, b.mean_codes);
    EXPECT_EQ(a.p999_codes, b.p999_codes);
    EXPECT_EQ(a.worst_x, b.worst_x);
    EXPECT_EQ(a.worst_y, b.worst_y);
    EXPECT_EQ(a.differing, b.differing);
    EXPECT_EQ(a.meter_error_ev, b.meter_error_ev);
    EXPECT_EQ(a.bloom_error, b.bloom_error);
    for (uint32_t y = 0; y < c.height; ++y) {
      const auto is = (*sliced)->memory.error_map_row(y), should = whole->memory.error_map_row(y);
      EXPECT_EQ(std::memcmp(is.data(), should.data(), is.size_bytes()), 0) << "row " << y;
    }
  }
}

}  // namespace
}  // namespace candela::testing
