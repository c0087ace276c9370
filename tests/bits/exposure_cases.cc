#include <cmath>

#include "absl/strings/str_cat.h"
#include "proto/candela/v1/settings.h"
#include "server/base/check.h"
#include "server/session/exposure_track.h"
#include "tests/bits/bits.h"
#include "tests/support/settings.h"

namespace candela::testing {

namespace {

double between(double low, double high, uint32_t i, uint32_t channel) {
  return low + (high - low) * (double{noise(i, 0, channel)} + 0x1p-24 * double{noise(i, 1, channel)});
}

v1::Settings adapting(v1::Adaptation::Domain domain) {
  v1::Settings settings;
  settings.mutable_exposure()->set_min_exposure(0x1p-20);
  settings.mutable_exposure()->set_max_exposure(0x1p20);
  *settings.mutable_exposure()->mutable_adaptation() = adaptation(domain, 3, 1);
  return settings;
}

// The exposures of many means and lengths of time, without frames.
Bits many_exposures(v1::Adaptation::Domain domain) {
  const Settings settings = Settings::from(adapting(domain)).value();
  Bits bits;
  for (uint32_t i = 0; i < 20000; ++i) {
    const PreviousExposure previous = {steps_of_light(static_cast<float>(between(-12, 12, i, 1))),
                                       between(0, i % 3 == 0 ? 10 : 0.3, i, 2)};
    const Exposed exposed = expose(settings->exposure(), previous, between(-14, 14, i, 3));
    bits.numbers.add(exposed.exposure);
    bits.numbers.add(exposed.target);
  }
  return bits;
}

// A sequence whose light changes.
Bits sequence(Bench& bench, v1::Adaptation::Domain domain) {
  Bits bits;
  std::optional<PreviousExposure> previous;
  for (uint32_t i = 0; i < 12; ++i) {
    const float light = std::ldexp(1.0f, static_cast<int>(i % 4) - 1);
    const TexelFunction picture = mixed_picture(97, 41);
    const WireFrame frame = make_frame(97, 41, v1::PIXEL_FORMAT_RGBA16F, [&](uint32_t x, uint32_t y) {
      Texel t = picture(x, y);
      for (size_t k = 0; k < 3; ++k) t[k] *= light;
      return t;
    });
    render_frame(bench, frame, adapting(domain), i, &previous, bits);
  }
  return bits;
}

// A session of 2000 frames, whose light wanders and jumps.
Bits session(v1::Adaptation::Domain domain, uint32_t lookahead) {
  const Settings settings = Settings::from(adapting(domain)).value();
  ExposureTrack track(lookahead, /*cut_threshold_ev=*/0.5, {});
  Bits bits;
  const auto take = [&] {
    while (const std::optional<FrameExposure> frame = track.next()) {
      const ExposurePoint& point = frame->point;
      for (const double factor : {point.exposed.exposure, point.exposed.target, point.before})
        bits.numbers.add(factor);
      bits.numbers.add(point.cut);
    }
  };
  for (uint32_t i = 0; i < 2000; ++i) {
    CHECK(track.add(i, int64_t{i} * 41'666'667, /*cut=*/i % 97 == 0, settings->exposure()).ok());
    FrameStats stats;
    stats.mean_log2_luminance = between(-10, 10, i / 50, 1) + between(-0.2, 0.2, i, 2);
    stats.metered_weight = 1;
    for (uint32_t cell = 0; cell < stats.print.size(); ++cell)
      stats.print[cell] = static_cast<float>(stats.mean_log2_luminance) + noise(i / 20, cell, 3);
    if (i % 31 == 7) {
      track.failed(i);
    } else {
      track.metered(i, stats);
    }
    take();
  }
  track.end();
  take();
  return bits;
}

}  // namespace

std::vector<Case> exposure_cases() {
  std::vector<Case> all;
  for (const v1::Adaptation::Domain domain : {v1::Adaptation::DOMAIN_LINEAR, v1::Adaptation::DOMAIN_LOG}) {
    const std::string word = v1::word_of(domain);
    all.push_back({word + " adaptation, 20000 exposures", [=](Bench&) { return many_exposures(domain); }});
    all.push_back({word + " adaptation, 12 frames", [=](Bench& bench) { return sequence(bench, domain); }});
    for (const uint32_t lookahead : {0u, 3u, 16u}) {
      all.push_back({absl::StrCat(word, " adaptation, 2000 frames, look-ahead ", lookahead),
                     [=](Bench&) { return session(domain, lookahead); }});
    }
  }
  return all;
}

}  // namespace candela::testing
