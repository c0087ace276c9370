// Each tier renders as its numbers say, and its error against the whole pipeline is as published.
#include "server/render/settings/tiers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <memory>

#include "server/render/color/aces.h"
#include "server/render/reference/verify.h"
#include "server/render/tier_numbers.h"
#include "tests/support/device_fixture.h"
#include "tests/support/files.h"
#include "tests/support/settings.h"

namespace candela::testing {
namespace {

// The error of the sRGB polynomial in codes, and the error of everything else.
double transfer_bound(const Tier& tier) { return tier.transfer_terms == 6 ? 0.083 : 0.0002; }
constexpr double kRestBound = 4e-4;

class Tiers : public DeviceTest {
 protected:
  // A static tier, which must not be deleted.
  static std::shared_ptr<Renderer> shared_renderer() {
    return {&renderer(), [](Renderer*) {}};
  }
  static Verification against(const WireFrame& frame, const v1::Settings& settings,
                              uint32_t bloom_level_size) {
    auto rendered = render(frame, settings, {}, Verify::kYes);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return verify_frame(rendered->memory, rendered->report.plan, rendered->report.stats, bloom_level_size)
        .rounded;
  }
};

TEST_F(Tiers, ShadersAreTheTwinsOfTheirNumbersAtEverySizeAndKindOfBloom) {
  for (const Tier& tier : tiers()) {
    for (v1::Bloom::Kind kind : {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
      for (uint32_t levels : {1u, 2u, 5u}) {
        for (const auto& [width, height] : {std::pair{1u, 1u},
                                            {1u, 7u},
                                            {3u, 5u},
                                            {5u, 6u},
                                            {6u, 5u},
                                            {9u, 10u},
                                            {67u, 35u},
                                            {130u, 66u},
                                            {333u, 517u}}) {
          v1::Settings settings;
          settings.set_tier(tier.name);
          settings.mutable_bloom()->set_kind(kind);
          settings.mutable_bloom()->set_intensity(0.8f);
          settings.mutable_bloom()->set_levels(levels);
          const Verification difference = against(natural(width, height), settings, tier.bloom_level_size);
          EXPECT_LE(difference.max_codes, transfer_bound(tier) + kRestBound)
              << tier.name << " " << width << "x" << height << " bloom " << static_cast<int>(kind)
              << " levels " << levels << " at " << difference.worst_x << ", " << difference.worst_y;
        }
      }
    }
  }
}

TEST_F(Tiers, ErrorsAreNotWorseThanPublished) {
  std::printf("%-12s %-28s %9s %9s %9s\n", "tier", "codes against the reference", "max", "p99.9", "mean");
  for (const Tier& tier : tiers()) {
    v1::Settings settings;
    settings.set_tier(tier.name);
    const auto show = [&](const char* what, const WireFrame& frame, double bound) {
      const Verification d = against(frame, settings, 2);
      std::printf("%-12s %-28s %9.4f %9.4f %9.5f\n", tier.name, what, d.max_codes, d.p999_codes,
                  d.mean_codes);
      EXPECT_LE(d.max_codes, bound) << tier.name << " " << what;
    };
    const bool full_bloom = tier.bloom_level_size == 2;
    const double plain = transfer_bound(tier) + kRestBound;
    show("natural 641x359", natural(641, 359), full_bloom ? plain : 110.0);
    for (const HardCase& hard : hard_cases(131, 67)) {
      show(hard.name.c_str(), make_frame(131, 67, v1::PIXEL_FORMAT_RGBA16F, hard.texel),
           full_bloom ? plain : 110.0);
    }
    settings.mutable_bloom()->set_intensity(0);
    show("natural, no bloom", natural(641, 359), plain);
  }
}

// A flat table hides errors that a steep one shows.
TEST_F(Tiers, NumbersOfATableAreItsOwn) {
  TierBenchmark benchmark(shared_renderer, "a device", "");
  const auto error_of_draft = [&benchmark](const ColorTable& table) {
    v1::Settings settings;
    settings.set_curve(v1::TONE_CURVE_TABLE);
    *settings.mutable_table() = to_message(table);
    const auto numbers = benchmark.numbers({64, 48, v1::PIXEL_FORMAT_RGBA16F}, checked(settings));
    EXPECT_TRUE(numbers.ok()) << numbers.status();
    return numbers.ok() && numbers->front().tier == "draft" ? numbers->front().max_error_codes : -1.0;
  };
  ColorTable table = **aces_1_table(17);
  const double steep = error_of_draft(table);
  EXPECT_GT(steep, 0.0);
  std::fill(table.values.begin(), table.values.end(), uint16_t{20000});
  EXPECT_LT(error_of_draft(table), steep / 2);
}

TEST_F(Tiers, NumbersThatCannotBeReadAreMeasured) {
  const TemporaryFolder folder;
  write_file(folder.path("damaged"), "{\"a\": [1, ");
  for (const std::string& file : {folder.path("damaged"), folder.path("none"), folder.path(".")}) {
    TierBenchmark benchmark(shared_renderer, "a device", file);
    EXPECT_TRUE(benchmark.numbers({8, 8, v1::PIXEL_FORMAT_RGBA16F}, {}).ok()) << file;
  }
}

}  // namespace
}  // namespace candela::testing
