// The settings of HDR displays: what is left unset, and what does not go together.
#include "server/render/settings/hdr_display.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "server/render/color/hdr_signal.h"
#include "server/render/settings/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

using Change = std::function<void(v1::Settings&)>;

absl::StatusOr<Settings> settings_with(const std::vector<Change>& changes) {
  v1::Settings message;
  for (const Change& change : changes) change(message);
  return Settings::from(message);
}

const Change kPq = [](v1::Settings& s) { s.set_transfer(v1::TRANSFER_PQ); };
const Change kHlg = [](v1::Settings& s) { s.set_transfer(v1::TRANSFER_HLG); };
const Change kAces2 = [](v1::Settings& s) { s.set_curve(v1::TONE_CURVE_ACES_2); };
const Change kP3 = [](v1::Settings& s) { s.set_display_primaries(v1::PRIMARIES_P3_D65); };
Change peak(double nits) {
  return [=](v1::Settings& s) { s.set_peak_nits(nits); };
}
Change source_peak(double nits) {
  return [=](v1::Settings& s) { s.set_source_peak_nits(nits); };
}
Change limit(v1::Primaries primaries) {
  return [=](v1::Settings& s) { s.set_limit_primaries(primaries); };
}

TEST(HdrDisplay, HasThePublishedSignals) {
  for (const auto& [nits, signal] :
       {std::pair(0.0, 7.30955903e-7), std::pair(1.0, .149945732), std::pair(100.0, .508078421517),
        std::pair(203.0, .580688881042), std::pair(1000.0, .751827096247), std::pair(4000.0, .902572393311),
        std::pair(10000.0, 1.0)}) {
    EXPECT_NEAR(pq_signal(nits / 10000), signal, 1e-9) << nits;
  }
  for (const auto& [nits, gamma] : {std::pair(1000.0, 1.2), std::pair(2000.0, 1.326432598)}) {
    EXPECT_NEAR(1 / (1 + hlg_exponent(nits)), gamma, 1e-9) << nits;
  }
}

TEST(HdrDisplay, TakesItsOwnDefaults) {
  for (const Change& transfer : {kPq, kHlg}) {
    ASSERT_OK_AND_ASSIGN(const Settings settings, settings_with({transfer}));
    EXPECT_EQ(settings->curve(), v1::TONE_CURVE_BT2390);
    EXPECT_EQ(settings->output_format(), v1::OUTPUT_FORMAT_RGBA16);
    EXPECT_EQ(settings->display_primaries(), v1::PRIMARIES_REC2020);
    EXPECT_EQ(settings->peak_nits(), 1000);
    EXPECT_EQ(settings->source_peak_nits(), 10000);
    EXPECT_EQ(settings->limit_primaries(), v1::PRIMARIES_UNSPECIFIED);
  }
  ASSERT_OK_AND_ASSIGN(const Settings aces, settings_with({kPq, kAces2}));
  EXPECT_EQ(limit_of(*aces), v1::PRIMARIES_P3_D65);
  EXPECT_FALSE(aces->has_source_peak_nits());
  ASSERT_OK_AND_ASSIGN(const Settings sdr, settings_with({}));
  EXPECT_EQ(sdr->curve(), v1::TONE_CURVE_ACES_HILL);
  EXPECT_FALSE(sdr->has_peak_nits());
}

TEST(HdrDisplay, WhatGoesTogetherIsTaken) {
  const Change linear = [](v1::Settings& s) { s.set_curve(v1::TONE_CURVE_LINEAR); };
  for (const std::vector<Change>& changes : {std::vector<Change>{kPq, kP3, peak(100)},
                                             {kPq, peak(10000), source_peak(10000)},
                                             {kHlg, peak(400)},
                                             {kHlg, peak(2000), linear},
                                             {kPq, kAces2, peak(500)},
                                             {kHlg, kAces2, peak(2000)},
                                             {kPq, kAces2, peak(4000), limit(v1::PRIMARIES_REC2020)},
                                             {kPq, kP3, kAces2, limit(v1::PRIMARIES_P3_D65)}}) {
    EXPECT_OK(settings_with(changes));
  }
}

TEST(HdrDisplay, WhatDoesNotGoTogetherIsRefusedByName) {
  const auto curve = [](v1::ToneCurve c) { return Change([=](v1::Settings& s) { s.set_curve(c); }); };
  const auto output = [](v1::OutputFormat f) {
    return Change([=](v1::Settings& s) { s.set_output_format(f); });
  };
  struct Case {
    std::vector<Change> changes;
    std::string words;
  };
  for (const Case& one : std::vector<Case>{
           {{curve(v1::TONE_CURVE_BT2390)},
            "curve is bt2390, which is for HDR displays, and transfer is srgb"},
           {{peak(1000)}, "peak_nits is 1000, which is for HDR displays"},
           {{source_peak(1000)}, "source_peak_nits is 1000, which is for HDR displays"},
           {{kP3}, "display_primaries is p3-d65, which is for HDR displays"},
           {{limit(v1::PRIMARIES_P3_D65)}, "limit_primaries is p3-d65, which is for HDR displays"},
           {{kPq, curve(v1::TONE_CURVE_ACES_HILL)}, "curve is aces-hill and transfer is pq"},
           {{kPq, output(v1::OUTPUT_FORMAT_RGBA8)},
            "output_format is rgba8 and transfer is pq, which shows bands"},
           {{kHlg, output(v1::OUTPUT_FORMAT_RGBA16F)}, "output_format is rgba16f, which has no transfer"},
           {{kPq, peak(99)}, "peak_nits is 99"},
           {{kPq, peak(10001)}, "peak_nits is 10001"},
           {{kHlg, peak(399)}, "peak_nits is 399; with hlg it must be between 400 and 2000"},
           {{kHlg, peak(2001)}, "peak_nits is 2001; with hlg it must be between 400 and 2000"},
           {{kPq, kAces2, peak(1500)}, "curve is aces-2, which is published for 500, 1000, 2000 and 4000"},
           {{kPq, kAces2, source_peak(4000)}, "only bt2390 has a source's peak"},
           {{kPq, peak(1000), source_peak(999)}, "source_peak_nits is 999 and peak_nits is 1000"},
           {{kPq, limit(v1::PRIMARIES_P3_D65)}, "curve is bt2390; only aces-2 has a limit"},
           {{kPq, kAces2, kP3, limit(v1::PRIMARIES_REC2020)},
            "limit_primaries is rec2020 and display_primaries is p3-d65"},
           {{kPq, kAces2, limit(v1::PRIMARIES_REC709)}, "limit_primaries is rec709"},
           {{kPq, [](v1::Settings& s) { s.set_display_primaries(v1::PRIMARIES_REC709); }},
            "HDR displays have rec2020 or p3-d65"}}) {
    const absl::Status status = settings_with(one.changes).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << one.words;
    EXPECT_NE(status.message().find(one.words), absl::string_view::npos) << status.message();
  }
}

}  // namespace
}  // namespace candela::testing
