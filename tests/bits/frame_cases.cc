#include "absl/strings/str_cat.h"
#include "proto/candela/v1/settings.h"
#include "tests/bits/bits.h"
#include "tests/support/settings.h"

namespace candela::testing {

namespace {

struct Kind {
  const char* name;
  void (*change)(v1::Settings&);
};

class Cases {
 public:
  void add(const std::string& name, WireFrame frame, v1::Settings settings) {
    all_.push_back({name, [frame = std::move(frame), settings = std::move(settings)](Bench& bench) {
                      return render_frame(bench, frame, settings);
                    }});
  }
  std::vector<Case> take() { return std::move(all_); }

 private:
  std::vector<Case> all_;
};

constexpr uint32_t kWidth = 131, kHeight = 67;

constexpr v1::PixelFormat kFormats[] = {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F,
                                        v1::PIXEL_FORMAT_RGB9E5};
constexpr v1::OutputFormat kOutputs[] = {v1::OUTPUT_FORMAT_RGBA8, v1::OUTPUT_FORMAT_RGBA16,
                                         v1::OUTPUT_FORMAT_RGBA16F};

WireFrame mixed(uint32_t width = kWidth, uint32_t height = kHeight,
                v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F) {
  return make_frame(width, height, format, mixed_picture(width, height));
}
WireFrame plain_picture(v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F) {
  return make_frame(kWidth, kHeight, format, ordinary(mixed_picture(kWidth, kHeight)));
}

// A client's table, of exact arithmetic.
v1::Settings with_table(uint32_t axes) {
  constexpr uint32_t kSize = 9;
  std::vector<float> rgb = lattice_light(kSize, axes, 32);
  for (float& v : rgb) v = v > 0 ? v / (v + 0.5f) : 0.5f * v;
  v1::Settings settings;
  settings.set_curve(v1::TONE_CURVE_TABLE);
  *settings.mutable_table() = to_message(make_color_table(kSize, axes, 32, rgb));
  return settings;
}

std::vector<std::pair<std::string, v1::Settings>> curves() {
  std::vector<std::pair<std::string, v1::Settings>> all;
  for (int curve = v1::TONE_CURVE_LINEAR; curve <= v1::TONE_CURVE_SHOULDER; ++curve) {
    if (curve == v1::TONE_CURVE_TABLE) continue;
    v1::Settings settings;
    settings.set_curve(static_cast<v1::ToneCurve>(curve));
    if (curve == v1::TONE_CURVE_ACES_1) settings.set_tier("draft");  // its tables are smaller
    all.emplace_back(v1::word_of(settings.curve()), settings);
  }
  for (const uint32_t axes : {shader::AXES_ACES, shader::AXES_REC709, shader::AXES_AP1}) {
    all.emplace_back(absl::StrCat("table, axes ", axes), with_table(axes));
  }
  return all;
}

void add_displays(Cases& cases) {
  for (const v1::ToneCurve curve : {v1::TONE_CURVE_LINEAR, v1::TONE_CURVE_BT2390, v1::TONE_CURVE_ACES_2}) {
    for (const v1::Transfer transfer : {v1::TRANSFER_PQ, v1::TRANSFER_HLG}) {
      for (const v1::Primaries display : {v1::PRIMARIES_REC2020, v1::PRIMARIES_P3_D65}) {
        v1::Settings settings;
        settings.set_curve(curve);
        settings.set_transfer(transfer);
        settings.set_display_primaries(display);
        settings.set_alpha(display == v1::PRIMARIES_P3_D65 ? v1::ALPHA_STRAIGHT : v1::ALPHA_ASSOCIATED);
        settings.set_input_primaries(v1::PRIMARIES_ACES_AP1);
        cases.add(absl::StrCat(v1::word_of(curve), ", ", v1::word_of(transfer), ", ", v1::word_of(display)),
                  mixed(), settings);
      }
    }
  }
}

void add_gain_maps(Cases& cases) {
  v1::Settings settings;
  settings.set_gain_map_peak_nits(1000);
  cases.add("gain map", mixed(), settings);
  settings.set_alpha(v1::ALPHA_OVER);
  settings.mutable_output_size()->set_width(40);
  cases.add("gain map, over, 40 wide", mixed(), settings);
}

void add_curves(Cases& cases) {
  for (const auto& [name, curve] : curves()) {
    for (const v1::Transfer transfer : {v1::TRANSFER_SRGB, v1::TRANSFER_GAMMA22, v1::TRANSFER_LINEAR}) {
      v1::Settings settings = curve;
      settings.set_transfer(transfer);
      cases.add(absl::StrCat(name, ", ", v1::word_of(transfer)), mixed(), settings);
    }
    for (const v1::OutputFormat output : kOutputs) {
      for (const bool dither : {false, true}) {
        v1::Settings settings = curve;
        settings.set_output_format(output);
        settings.set_dither(dither);
        cases.add(absl::StrCat(name, ", ", v1::word_of(output), dither ? ", dither" : "", ", opaque"),
                  plain_picture(), settings);
      }
    }
    v1::Settings draft = curve;
    draft.set_tier("draft");
    draft.set_input_primaries(v1::PRIMARIES_REC2020);
    cases.add(absl::StrCat(name, ", draft, rec2020"), mixed(), draft);
  }
}

void add_input(Cases& cases) {
  for (const v1::PixelFormat format : kFormats) {
    for (int primaries = v1::PRIMARIES_REC709; primaries <= v1::PRIMARIES_XYZ; ++primaries) {
      v1::Settings settings;
      settings.set_input_primaries(static_cast<v1::Primaries>(primaries));
      cases.add(absl::StrCat(v1::word_of(format), ", ", v1::word_of(settings.input_primaries())),
                mixed(kWidth, kHeight, format), settings);
    }
  }
  v1::Settings dci;
  *dci.mutable_input_chromaticities() =
      to_message(Chromaticities{{0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.314, 0.351}});
  cases.add("chromaticities of DCI-P3", mixed(), dci);
  for (const double kelvin : {2000.0, 3200.0, 5003.5, 25000.0}) {
    for (const double tint : {-1.0, 0.0, 0.37}) {
      v1::Settings settings = at_ev(0.5);
      settings.set_white_balance(kelvin);
      settings.set_tint(tint);
      cases.add(absl::StrCat("white ", kelvin, " K, tint ", tint),
                mixed(kWidth, kHeight, v1::PIXEL_FORMAT_RGBA32F), settings);
    }
  }
  for (const v1::PixelFormat format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    for (const HardCase& hard : hard_cases(kWidth, kHeight)) {
      cases.add(absl::StrCat(hard.name, ", ", v1::word_of(format)),
                make_frame(kWidth, kHeight, format, hard.texel), {});
    }
  }
  // Light beyond the largest half, and denormals of floats.
  const auto extreme = [](uint32_t x, uint32_t y) -> Texel {
    const float light = steps_of_light(static_cast<float>(x) - 80.0f) * (1 + noise(x, y, 1));
    return {light, 0.5f * light, y % 3 == 0 ? -light : light, 1 - noise(x, y, 2)};
  };
  for (const v1::Alpha alpha : {v1::ALPHA_ASSOCIATED, v1::ALPHA_STRAIGHT}) {
    v1::Settings settings;
    settings.set_alpha(alpha);
    settings.set_input_primaries(v1::PRIMARIES_ACES_AP0);
    cases.add(absl::StrCat("2^-80 to 2^50, ", v1::word_of(alpha)),
              make_frame(kWidth, kHeight, v1::PIXEL_FORMAT_RGBA32F, extreme), settings);
  }
}

constexpr Kind kBlooms[] = {
    {"threshold 0", [](v1::Settings& s) { s.mutable_bloom()->set_threshold(0); }},
    {"threshold 4", [](v1::Settings& s) { s.mutable_bloom()->set_threshold(4); }},
    {"hard", [](v1::Settings& s) { s.mutable_bloom()->set_softness(0); }},
    {"soft", [](v1::Settings& s) { s.mutable_bloom()->set_softness(1); }},
    {"1 level", [](v1::Settings& s) { s.mutable_bloom()->set_levels(1); }},
    {"16 levels", [](v1::Settings& s) { s.mutable_bloom()->set_levels(16); }},
    {"without firefly weights", [](v1::Settings& s) { s.mutable_bloom()->set_firefly_weights(false); }},
};

void add_bloom(Cases& cases) {
  for (const v1::Bloom::Kind kind :
       {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
    for (const char* tier : {"draft", "standard"}) {
      for (const Kind& change : kBlooms) {
        v1::Settings settings = at_ev(-1);
        settings.mutable_bloom()->set_kind(kind);
        settings.mutable_bloom()->set_intensity(0.4f);
        settings.set_tier(tier);
        change.change(settings);
        cases.add(absl::StrCat(v1::word_of(kind), ", ", tier, ", ", change.name), mixed(), settings);
      }
    }
  }
}

void add_metering(Cases& cases) {
  for (const v1::Metering::Statistic statistic : kStatistics) {
    for (const v1::Metering::Weights weights : kWeights) {
      for (const float below : {0.0f, 0.01f}) {
        const v1::Settings settings = metering_settings(statistic, weights, below);
        const std::string name =
            absl::StrCat(v1::word_of(statistic), ", ", v1::word_of(weights), ", ignore below ", below);
        cases.add(name, mixed(), settings);
        cases.add(name + ", opaque", plain_picture(), settings);
      }
    }
  }
}

constexpr Kind kExposures[] = {
    {"percentiles 1 to 99",
     [](v1::Settings& s) {
       v1::Metering& metering = *s.mutable_exposure()->mutable_metering();
       metering.set_statistic(v1::Metering::STATISTIC_PERCENTILE);
       metering.set_percentile_low(1);
       metering.set_percentile_high(99);
     }},
    {"compensation 1.5", [](v1::Settings& s) { s.mutable_exposure()->set_compensation_ev(1.5); }},
    {"key 0.09", [](v1::Settings& s) { s.mutable_exposure()->set_key(0.09); }},
    {"at least 2", [](v1::Settings& s) { s.mutable_exposure()->set_min_exposure(2); }},
    {"at most 0.02", [](v1::Settings& s) { s.mutable_exposure()->set_max_exposure(0.02); }},
};

void add_exposures(Cases& cases) {
  for (const Kind& change : kExposures) {
    v1::Settings settings;
    change.change(settings);
    cases.add(change.name, mixed(), settings);
  }
}

void add_alpha(Cases& cases) {
  for (const v1::Alpha alpha : {v1::ALPHA_ASSOCIATED, v1::ALPHA_STRAIGHT, v1::ALPHA_OVER, v1::ALPHA_IGNORE}) {
    for (const v1::OutputFormat output : kOutputs) {
      v1::Settings settings;
      settings.set_alpha(alpha);
      settings.set_output_format(output);
      if (alpha == v1::ALPHA_OVER) settings.mutable_background()->set_green(0.7f);
      cases.add(absl::StrCat(v1::word_of(alpha), ", ", v1::word_of(output)), mixed(), settings);
    }
  }
}

// In the ways that differ most, as one size follows another.
constexpr Kind kPictures[] = {
    {"threshold 0.05", [](v1::Settings& s) { s.mutable_bloom()->set_threshold(0.05f); }},
    {"draft, dither",
     [](v1::Settings& s) {
       s.set_tier("draft");
       s.set_dither(true);
     }},
    {"conserve, agx, prescale 0.7",
     [](v1::Settings& s) {
       s.mutable_bloom()->set_kind(v1::Bloom::KIND_CONSERVE);
       s.set_curve(v1::TONE_CURVE_AGX);
       s.set_prescale(0.7);
     }},
    {"gaussian, reinhard-extended, straight",
     [](v1::Settings& s) {
       s.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
       s.mutable_bloom()->set_threshold(1.5f);
       s.set_curve(v1::TONE_CURVE_REINHARD_EXTENDED);
       s.set_curve_white(2.5f);
       s.set_alpha(v1::ALPHA_STRAIGHT);
     }},
};

void add_sizes(Cases& cases) {
  constexpr Size kMore[] = {{641, 359}, {1, 300}, {700, 1}, {257, 64}};
  std::vector<Size> sizes(std::begin(kMore), std::end(kMore));
  for (uint32_t width = 1; width <= 67; width += 3) sizes.push_back({width, 1 + width * 5 % 67});
  for (size_t i = 0; i < sizes.size(); ++i) {
    const auto [width, height] = sizes[i];
    v1::Settings settings;
    kPictures[i % 4].change(settings);
    settings.set_output_format(kOutputs[i % 3]);
    cases.add(absl::StrCat(width, "x", height, ", ", kPictures[i % 4].name),
              mixed(width, height, kFormats[i % 3]), settings);
  }
}

// Other sizes of the image: a whole factor, Lanczos up and down, one axis alone, and a factor whose rows are
// too many to keep.
void add_resized(Cases& cases) {
  constexpr Size kImages[] = {{131, 67}, {40, 33}, {40, 67}, {80, 134},
                              {131, 20}, {300, 1}, {7, 150}, {1, 1}};
  constexpr Size kFrames[] = {{131, 67}, {280, 99}, {700, 402}, {2, 600}};
  size_t i = 0;
  for (const Size& frame : kFrames) {
    for (const Size& image : kImages) {
      v1::Settings settings;
      kPictures[i % 4].change(settings);
      settings.set_output_format(kOutputs[i % 3]);
      settings.mutable_output_size()->set_width(image.width);
      settings.mutable_output_size()->set_height(image.height);
      const std::string name = absl::StrCat(frame.width, "x", frame.height, " to ", image.width, "x",
                                            image.height, ", ", kPictures[i % 4].name);
      const bool opaque = i % 5 == 0;
      const TexelFunction picture = mixed_picture(frame.width, frame.height);
      cases.add(opaque ? name + ", opaque" : name,
                make_frame(frame.width, frame.height, kFormats[i % 3], opaque ? ordinary(picture) : picture),
                settings);
      ++i;
    }
  }
}

}  // namespace

std::vector<Case> frame_cases() {
  Cases cases;
  add_curves(cases);
  add_displays(cases);
  add_gain_maps(cases);
  add_input(cases);
  add_bloom(cases);
  add_metering(cases);
  add_exposures(cases);
  add_alpha(cases);
  add_sizes(cases);
  add_resized(cases);
  return cases.take();
}

}  // namespace candela::testing
