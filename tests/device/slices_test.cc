// Frames in slices: many, with the same bits, and others in between.
#include "server/base/slices.h"

#include <cmath>
#include <cstring>
#include <functional>
#include <optional>
#include <string>

#include "absl/synchronization/blocking_counter.h"
#include "absl/time/clock.h"
#include "server/render/settings/settings.h"
#include "server/schedule/render_loop.h"
#include "tests/support/device_fixture.h"
#include "tests/support/status.h"

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
    SlicedWork work([&] { sliced = render_it(); }, real_clock());
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

// What the passes of a large frame have to get through: bloom, a colour table, a histogram, dither, long
// rows.
std::vector<Case> large_frames() {
  std::vector<Case> all(6);
  all[0] = {"bright", 2304, 1024, {}};
  all[1] = {"aces-1", 2304, 1024, {}};
  all[1].settings.set_curve(v1::TONE_CURVE_ACES_1);
  all[2] = {"gaussian bloom", 2304, 1024, {}};
  all[2].settings.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
  all[3] = {"draft, percentiles, dither", 2304, 1024, {}};
  all[3].settings.set_tier("draft");
  all[3].settings.set_dither(true);
  all[3].settings.mutable_exposure()->mutable_metering()->set_statistic(v1::Metering::STATISTIC_PERCENTILE);
  all[4] = {"rows of 16384", 16384, 130, {}};
  all[5] = {"resized", 2304, 1024, {}};
  all[5].settings.mutable_output_size()->set_percent(70);
  return all;
}

// A table of two points a side that no other number has.
v1::Settings with_table(int number) {
  v1::Settings settings;
  settings.set_curve(v1::TONE_CURVE_TABLE);
  settings.mutable_table()->set_size(2);
  settings.mutable_table()->set_values(std::string(48, static_cast<char>(number)));
  return settings;
}

// Not all of it is lit, and some of it is absent, negative or not finite.
WireFrame trying(uint32_t width, uint32_t height) {
  return make_frame(width, height, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) {
    Texel t = scenes::natural(width, height)(x, y);
    if (x % 700 < 300 && y % 400 < 200) {
      for (size_t k = 0; k < 3; ++k) t[k] = std::min(t[k], 0.2f);
    }
    if (x % 97 == 5) t[3] = 0.5f;
    if (x % 501 == 7) t[0] = -0.25f;
    if (x == 11 && y % 50 == 3) t[1] = NAN;
    return t;
  });
}

TEST_F(Slices, ALargeFramePausesInEveryPassAndOthersInBetweenChangeNoneOfItsBits) {
  const WireFrame other = natural(200, 120);
  for (const ExecutorKind executor : {ExecutorKind::kDevice, ExecutorKind::kHost}) {
    if (executor == ExecutorKind::kHost && renderer().executor_kind() != ExecutorKind::kHost) continue;
    Renderer& by = renderer_with(executor);
    for (const Case& c : large_frames()) {
      SCOPED_TRACE(::testing::Message() << executor_word(executor) << ", " << c.name);
      const WireFrame frame = trying(c.width, c.height);
      const auto render_it = [&] {
        return render_on(by, frame, c.settings, {.sequence = 3, .previous = {}});
      };
      const absl::StatusOr<Rendered> whole = render_it();
      std::optional<absl::StatusOr<Rendered>> sliced;
      SlicedWork work([&] { sliced = render_it(); }, real_clock());
      int slices = 1;
      for (; !work.run(absl::ZeroDuration()); ++slices) {
        if (slices % 8 != 0) continue;
        // Others use the recorder and the crew, and their tables push the frame's out.
        for (int i = 0; i < 5; ++i) ASSERT_OK(render_on(by, other, with_table(slices + i)));
      }
      ASSERT_TRUE(whole.ok() && (*sliced).ok()) << whole.status() << (*sliced).status();
      std::cout << executor_word(executor) << ", " << c.name << ": " << slices << " slices\n";
      EXPECT_GE(slices, 20);
      EXPECT_EQ(image(whole->memory), image((*sliced)->memory));
      EXPECT_EQ(whole->report.exposure, (*sliced)->report.exposure);
      EXPECT_EQ(whole->report.stats.metered_mean(), (*sliced)->report.stats.metered_mean());
      EXPECT_EQ(whole->report.stats.negative_components, (*sliced)->report.stats.negative_components);
      EXPECT_EQ(whole->report.gamut_cut_components, (*sliced)->report.gamut_cut_components);
    }
  }
}

Exposed one() {
  Exposed exposed;
  exposed.exposure = 1.0;
  return exposed;
}

// The order in which a large frame and a small one end, of two flows. The small one is submitted between the
// two phases of the large one, which by then is on its way.
std::vector<std::string> order_of_two(const std::function<std::shared_ptr<Frame>(Size)>& make,
                                      absl::Duration slice) {
  absl::Mutex mutex;
  std::vector<std::string> order;
  absl::BlockingCounter ended(2);
  RenderLoop loop(run_job, 4, real_clock(), slice);
  const auto job = [&](std::string name, Size size, Flow flow) {
    FrameJob made;
    made.frame = make(size);
    made.flow = flow;
    made.decide = [](const FrameStats&) { return one(); };
    made.done = [&, name](const absl::StatusOr<RenderedFrame>& rendered) {
      EXPECT_OK(rendered);
      const absl::MutexLock lock(&mutex);
      order.push_back(name);
      ended.DecrementCount();
    };
    return made;
  };
  FrameJob large = job("large", {2304, 1024}, 1);
  FrameJob small = job("small", {64, 64}, 2);
  large.decide = [&](const FrameStats&) {
    EXPECT_OK(loop.submit(std::move(small)));
    return one();
  };
  EXPECT_OK(loop.submit(std::move(large)));
  ended.Wait();
  return order;
}

TEST_F(Slices, ASmallFrameDoesNotWaitForAnOrdinaryLargeOneOnTheDeviceNorOnTheHost) {
  for (const ExecutorKind executor : {ExecutorKind::kDevice, ExecutorKind::kHost}) {
    if (executor == ExecutorKind::kHost && renderer().executor_kind() != ExecutorKind::kHost) continue;
    Renderer& by = renderer_with(executor);
    const auto make = [&](Size size) {
      const Settings settings = Settings::from({}).value();
      FrameMemory memory = by.allocate({size.width, size.height, v1::PIXEL_FORMAT_RGBA16F}, settings).value();
      for (uint32_t y = 0; y < size.height; ++y) {
        std::fill(memory.input_row(y).begin(), memory.input_row(y).end(), std::byte{0x38});
      }
      return std::make_shared<Frame>(Frame{{&by, [](Renderer*) {}}, std::move(memory), settings});
    };
    EXPECT_EQ(order_of_two(make, absl::ZeroDuration()), (std::vector<std::string>{"small", "large"}));
    // Without slices it does.
    EXPECT_EQ(order_of_two(make, absl::InfiniteDuration()), (std::vector<std::string>{"large", "small"}));
  }
}

TEST_F(Slices, AFrameOfMoreThanTwoMegapixelsTakesLong) {
  const Settings settings = Settings::from({}).value();
  const auto takes_long = [&](uint32_t width, uint32_t height) {
    return renderer().allocate({width, height, v1::PIXEL_FORMAT_RGB9E5}, settings)->takes_long();
  };
  EXPECT_FALSE(takes_long(1920, 1080));
  EXPECT_FALSE(takes_long(2048, 1024));
  EXPECT_TRUE(takes_long(2049, 1024));
  EXPECT_TRUE(takes_long(16384, 129));
  EXPECT_FALSE(FrameMemory().takes_long());
}

}  // namespace
}  // namespace candela::testing
