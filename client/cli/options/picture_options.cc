#include "client/cli/options/picture_options.h"

#include <algorithm>
#include <array>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/cli/options/enum_words.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/usage.h"
#include "client/cli/options/view_options.h"
#include "client/image/image.h"

namespace candela {
namespace {

constexpr char kMetering[] = "Metering";
constexpr char kBloom[] = "Bloom";
constexpr char kTone[] = "Tone";

constexpr v1::Range<double> kJpegQuality{v1::kJpegQuality.min, v1::kJpegQuality.max};

// The wire's defaults, see render.proto.
constexpr v1::Metering::Statistic kDefaultStatistic = v1::Metering::STATISTIC_LOG_AVERAGE;
constexpr v1::Metering::Weights kDefaultWeights = v1::Metering::WEIGHTS_AVERAGE;
constexpr v1::Adaptation::Domain kDefaultDomain = v1::Adaptation::DOMAIN_LOG;
constexpr v1::Bloom::Kind kDefaultBloom = v1::Bloom::KIND_MIP;
constexpr v1::Primaries kDefaultPrimaries = v1::PRIMARIES_REC709;
constexpr v1::Transfer kDefaultTransfer = v1::TRANSFER_SRGB;
constexpr v1::BadValues kDefaultBadValues = v1::BAD_VALUES_SCRUB;

absl::Status set_exposure(v1::Exposure& exposure, const std::string& text) {
  exposure.clear_manual_ev();
  exposure.set_mode(v1::Exposure::MODE_AUTO);
  if (text == "auto") return absl::OkStatus();
  if (nearest(text, {"auto"}) == "auto") {
    return usage_error(absl::StrFormat("--exposure is \"%s\"; did you mean auto? It is auto or an EV, %s",
                                       text, format_range(v1::kManualEv)));
  }
  const absl::StatusOr<double> ev = parse_number("--exposure", text, v1::kManualEv);
  if (!ev.ok()) return usage_error(absl::StrFormat("%s, or auto", ev.status().message()));
  exposure.set_mode(v1::Exposure::MODE_MANUAL);
  exposure.set_manual_ev(*ev);
  return absl::OkStatus();
}

void add_exposure_options(CLI::App& app, v1::Exposure& exposure) {
  add_text(app, kExposureSection, "--exposure", "auto|EV",
           absl::StrFormat("Metered, or fixed at 2^EV; %s (default auto)", format_range(v1::kManualEv)),
           [&exposure](const std::string& text) { return set_exposure(exposure, text); });
  add_number(app, kExposureSection, "--compensation", "EV", v1::kCompensationEv, v1::kDefaultCompensationEv,
             "Added to the metered exposure", [&exposure](double ev) { exposure.set_compensation_ev(ev); });
  add_number(app, kExposureSection, "--key", "X", v1::kKey, v1::kDefaultKey,
             "What the metered mean is brought to", [&exposure](double key) { exposure.set_key(key); });
  add_number(app, kExposureSection, "--min-exposure", "X", v1::kExposureLimit, v1::kDefaultMinExposure,
             "Least factor that metering gives", [&exposure](double x) { exposure.set_min_exposure(x); });
  add_number(app, kExposureSection, "--max-exposure", "X", v1::kExposureLimit, v1::kDefaultMaxExposure,
             "Largest factor that metering gives", [&exposure](double x) { exposure.set_max_exposure(x); });
}

// "A,B,...": `count` numbers of one range.
absl::StatusOr<std::vector<double>> parse_list(const std::string& name, const std::string& text, size_t count,
                                               v1::Range<double> range, bool whole = false) {
  const std::vector<std::string> parts = absl::StrSplit(text, ',');
  if (parts.size() != count) {
    return usage_error(
        absl::StrFormat("%s is \"%s\"; it must be %d numbers with commas between", name, text, count));
  }
  std::vector<double> values;
  for (const std::string& part : parts) {
    const absl::StatusOr<double> value = parse_number(name, part, range, whole);
    if (!value.ok()) return usage_error(std::string(value.status().message()));
    values.push_back(*value);
  }
  return values;
}

void add_metering_options(CLI::App& app, v1::Metering& metering) {
  add_enum<v1::Metering::Statistic>(
      app, kMetering, "--metering", "statistic", kDefaultStatistic, "What of the luminance counts",
      [&metering](v1::Metering::Statistic statistic) { metering.set_statistic(statistic); });
  add_text(
      app, kMetering, "--percentiles", "LOW,HIGH",
      absl::StrFormat("Between which percentiles of the luminance, in percent; implies --metering percentile "
                      "(default %s,%s)",
                      format_number(v1::kDefaultPercentileLow), format_number(v1::kDefaultPercentileHigh)),
      [&metering](const std::string& text) {
        const auto values = parse_list("--percentiles", text, 2, v1::kPercentile);
        if (!values.ok()) return values.status();
        if ((*values)[1] - (*values)[0] < v1::kLeastPercentileRange) {
          return usage_error(
              absl::StrFormat("--percentiles is \"%s\"; the first must be smaller by %s or more", text,
                              format_number(v1::kLeastPercentileRange)));
        }
        metering.set_statistic(v1::Metering::STATISTIC_PERCENTILE);
        metering.set_percentile_low((*values)[0]);
        metering.set_percentile_high((*values)[1]);
        return absl::OkStatus();
      });
  add_enum<v1::Metering::Weights>(
      app, kMetering, "--weights", "weights", kDefaultWeights,
      "Which pixels count: all alike, most in the centre, or those of --spot",
      [&metering](v1::Metering::Weights weights) { metering.set_weights(weights); });
  add_text(app, kMetering, "--spot", "X0,Y0,X1,Y1",
           "Meter the pixels from X0,Y0 up to but without X1,Y1; implies --weights spot",
           [&metering](const std::string& text) {
             const auto values = parse_list("--spot", text, 4, {0, double{v1::kMaxDimension}}, true);
             if (!values.ok()) return values.status();
             metering.set_weights(v1::Metering::WEIGHTS_SPOT);
             v1::Rectangle& spot = *metering.mutable_spot();
             spot.set_x0(static_cast<uint32_t>((*values)[0]));
             spot.set_y0(static_cast<uint32_t>((*values)[1]));
             spot.set_x1(static_cast<uint32_t>((*values)[2]));
             spot.set_y1(static_cast<uint32_t>((*values)[3]));
             return absl::OkStatus();
           });
}

void add_adaptation_options(CLI::App& app, v1::Adaptation& adaptation) {
  add_enum<v1::Adaptation::Domain>(
      app, kExposureSection, "--adaptation", "domain", kDefaultDomain, "Adapt the factor or its logarithm",
      [&adaptation](v1::Adaptation::Domain domain) { adaptation.set_domain(domain); });
  add_number(app, kExposureSection, "--speed-up", "S", v1::kAdaptationSpeed, v1::kDefaultSpeedUp,
             "Adaptation to a darker scene, per second",
             [&adaptation](double s) { adaptation.set_speed_up(s); });
  add_number(app, kExposureSection, "--speed-down", "S", v1::kAdaptationSpeed, v1::kDefaultSpeedDown,
             "Adaptation to a brighter scene, per second",
             [&adaptation](double s) { adaptation.set_speed_down(s); });
}

void add_bloom_options(CLI::App& app, v1::Bloom& bloom) {
  add_enum<v1::Bloom::Kind>(app, kBloom, "--bloom", "kind of bloom", kDefaultBloom,
                            "Added from mip levels, mixed in without making light, or added from one blur",
                            [&bloom](v1::Bloom::Kind kind) { bloom.set_kind(kind); });
  add_number(app, kBloom, "--bloom-intensity", "X", v1::kBloomIntensity, v1::kDefaultBloomIntensity,
             "Factor on the bloom, 0 for none",
             [&bloom](double x) { bloom.set_intensity(static_cast<float>(x)); });
  add_number(app, kBloom, "--bloom-threshold", "L", v1::kBloomThreshold, v1::kDefaultBloomThreshold,
             absl::StrFormat(
                 "Scene luminance above which pixels bloom; of gaussian a multiple of the mean, default %s",
                 format_number(v1::kDefaultGaussianThreshold)),
             [&bloom](double x) { bloom.set_threshold(static_cast<float>(x)); });
  add_number(app, kBloom, "--bloom-softness", "X", v1::kBloomSoftness, v1::kDefaultBloomSoftness,
             "Width of the knee, a fraction of the threshold",
             [&bloom](double x) { bloom.set_softness(static_cast<float>(x)); });
  add_number(
      app, kBloom, "--bloom-levels", "N",
      {static_cast<double>(v1::kBloomLevels.min), static_cast<double>(v1::kBloomLevels.max)},
      v1::kDefaultBloomLevels, "How far it spreads: doublings of its radius",
      [&bloom](double n) { bloom.set_levels(static_cast<uint32_t>(n)); }, true);
  add_text(app, kBloom, "--bloom-firefly", "on|off",
           absl::StrFormat("Keep single bright pixels from flickering (default %s)",
                           v1::kDefaultFireflyWeights ? "on" : "off"),
           [&bloom](const std::string& text) {
             if (text != "on" && text != "off") {
               return usage_error(absl::StrFormat("--bloom-firefly is \"%s\"; it must be on or off", text));
             }
             bloom.set_firefly_weights(text == "on");
             return absl::OkStatus();
           });
}

// A number without a default.
void add_promise(CLI::App& app, const std::string& name, const std::string& unit, v1::Range<double> range,
                 const std::string& help, std::function<void(double)> set) {
  add_text(app, kTone, name, unit, absl::StrFormat("%s; %s", help, format_range(range)),
           [name, range, set = std::move(set)](const std::string& text) {
             const absl::StatusOr<double> value = parse_number(name, text, range);
             if (value.ok()) set(*value);
             return value.status();
           });
}

absl::Status set_primaries(v1::Settings& settings, const std::string& text) {
  settings.clear_input_primaries();
  settings.clear_input_chromaticities();
  if (!absl::StrContains(text, ',')) {
    const absl::StatusOr<int> named = enum_value(*v1::Primaries_descriptor(), "--primaries", text);
    if (!named.ok()) return named.status();
    settings.set_input_primaries(static_cast<v1::Primaries>(*named));
    return absl::OkStatus();
  }
  const auto xy = parse_list("--primaries", text, 8, {-2, 2});
  if (!xy.ok()) return xy.status();
  std::array<float, 8> values{};
  std::copy(xy->begin(), xy->end(), values.begin());
  *settings.mutable_input_chromaticities() = to_message(values);
  return absl::OkStatus();
}

void add_tone_options(CLI::App& app, v1::Settings& settings) {
  add_number(app, kTone, "--curve-white", "L", v1::kCurveWhite, v1::kDefaultCurveWhite,
             "Exposed luminance that reinhard-extended maps to white",
             [&settings](double white) { settings.set_curve_white(static_cast<float>(white)); });
  add_number(app, kTone, "--prescale", "X", v1::kPrescale, v1::kDefaultPrescale,
             "Factor between exposure and curve", [&settings](double x) { settings.set_prescale(x); });
  add_enum<v1::Transfer>(app, kTone, "--transfer", "transfer", kDefaultTransfer,
                         "Display encoding of .png and .jpg",
                         [&settings](v1::Transfer transfer) { settings.set_transfer(transfer); });
  add_text(app, kTone, "--tier", "NAME",
           absl::StrFormat("Accuracy against time; `candela info` lists them (default %s)", v1::kDefaultTier),
           [&settings](const std::string& tier) {
             settings.set_tier(tier);
             return absl::OkStatus();
           });
  add_promise(app, "--max-error", "CODES", v1::kMaxErrorCodes,
              "Instead of --tier: the fastest tier that is off by no more, in 1/255 of the display range",
              [&settings](double codes) { settings.set_max_error_codes(codes); });
  add_promise(app, "--max-ms", "MS", v1::kMaxMs,
              "Instead of --tier: the most accurate tier that takes no longer on the device",
              [&settings](double ms) { settings.set_max_ms(ms); });
  app.add_flag_callback(
         "--dither", [&settings] { settings.set_dither(true); }, "Add noise of +-1 code, which hides banding")
      ->group(kTone);
}

void add_pixel_options(CLI::App& app, v1::Settings& settings) {
  add_text(app, kTone, "--primaries", "NAME|XY",
           absl::StrFormat(
               "The image's primaries, whatever its file says: %s, or the x,y of red, green, blue and white "
               "as eight numbers (default: the file's, or %s)",
               absl::StrJoin(enum_words(*v1::Primaries_descriptor()), ", "),
               enum_word(*v1::Primaries_descriptor(), kDefaultPrimaries)),
           [&settings](const std::string& text) { return set_primaries(settings, text); });
  add_enum<v1::BadValues>(app, kTone, "--bad-values", "policy for bad values", kDefaultBadValues,
                          "What to do with NaN and Inf",
                          [&settings](v1::BadValues policy) { settings.set_bad_values(policy); });
}

EncodedTransfer encoded_transfer(v1::Transfer transfer) {
  return transfer == v1::TRANSFER_GAMMA22  ? EncodedTransfer::kGamma22
         : transfer == v1::TRANSFER_LINEAR ? EncodedTransfer::kLinear
                                           : EncodedTransfer::kSrgb;
}

absl::Status check_exposure_limits(const v1::Exposure& exposure) {
  const double min = exposure.has_min_exposure() ? exposure.min_exposure() : v1::kDefaultMinExposure;
  const double max = exposure.has_max_exposure() ? exposure.max_exposure() : v1::kDefaultMaxExposure;
  if (min <= max) return absl::OkStatus();
  return usage_error(
      absl::StrFormat("--min-exposure %s is above --max-exposure %s; give both so that it is not",
                      format_number(min), format_number(max)));
}

}  // namespace

v1::Chromaticities to_message(const std::array<float, 8>& xy) {
  v1::Chromaticities c;
  c.set_red_x(xy[0]);
  c.set_red_y(xy[1]);
  c.set_green_x(xy[2]);
  c.set_green_y(xy[3]);
  c.set_blue_x(xy[4]);
  c.set_blue_y(xy[5]);
  c.set_white_x(xy[6]);
  c.set_white_y(xy[7]);
  return c;
}

void add_settings_options(CLI::App& app, PictureOptions& options) {
  v1::Exposure& exposure = *options.settings.mutable_exposure();
  add_exposure_options(app, exposure);
  add_adaptation_options(app, *exposure.mutable_adaptation());
  add_metering_options(app, *exposure.mutable_metering());
  add_bloom_options(app, *options.settings.mutable_bloom());
  add_view_options(app, kTone, options);
  add_tone_options(app, options.settings);
  add_pixel_options(app, options.settings);
}

void add_meter_options(CLI::App& app, v1::Settings& settings) {
  add_exposure_options(app, *settings.mutable_exposure());
  add_metering_options(app, *settings.mutable_exposure()->mutable_metering());
  add_pixel_options(app, settings);
}

void add_image_options(CLI::App& app, PictureArguments& arguments) {
  add_text(app, kOutputSection, "--bits", "8|16", "Bits a component of a .png (default 8)",
           [&arguments](const std::string& text) {
             if (text != "8" && text != "16") {
               return usage_error(absl::StrFormat("--bits is \"%s\"; it must be 8 or 16", text));
             }
             arguments.bits = text == "8" ? 8 : 16;
             return absl::OkStatus();
           });
  add_number(
      app, kOutputSection, "--quality", "N", kJpegQuality, WriteOptions().jpeg_quality, "Quality of a .jpg",
      [&arguments](double n) { arguments.quality = static_cast<int>(n); }, true);
}

absl::Status check_meter_options(const v1::Settings& settings) {
  if (settings.exposure().metering().weights() == v1::Metering::WEIGHTS_SPOT &&
      !settings.exposure().metering().has_spot()) {
    return usage_error("--weights spot needs --spot X0,Y0,X1,Y1");
  }
  return check_exposure_limits(settings.exposure());
}

absl::Status finish_picture_options(PictureOptions& options, const PictureArguments& arguments,
                                    const std::string& output) {
  const absl::StatusOr<OutputKind> kind = output_kind(output);
  if (!kind.ok()) return usage_error(std::string(kind.status().message()));
  const bool encoded = *kind == OutputKind::kPng || *kind == OutputKind::kJpeg;
  if (arguments.bits == 16 && *kind != OutputKind::kPng) {
    return usage_error(absl::StrFormat("--bits 16 is for .png; %s has its own depth", output));
  }
  if (arguments.quality != 0 && *kind != OutputKind::kJpeg) {
    return usage_error(absl::StrFormat("--quality is for .jpg; %s loses nothing", output));
  }
  if (!encoded && options.view.config.empty() && options.settings.transfer() != v1::TRANSFER_UNSPECIFIED) {
    options.notes.push_back(
        absl::StrFormat("--transfer changes nothing: %s holds display-linear light", output));
  }
  options.settings.set_output_format(!encoded               ? v1::OUTPUT_FORMAT_RGBA16F
                                     : arguments.bits == 16 ? v1::OUTPUT_FORMAT_RGBA16
                                                            : v1::OUTPUT_FORMAT_RGBA8);
  options.write.transfer = encoded_transfer(options.settings.transfer());
  if (arguments.quality != 0) options.write.jpeg_quality = arguments.quality;
  if (absl::Status status = finish_view_options(options, output, encoded); !status.ok()) return status;
  if (!options.settings.tier().empty() &&
      (options.settings.has_max_error_codes() || options.settings.has_max_ms())) {
    return usage_error(
        "--max-error and --max-ms choose the tier that --tier names; give the one or the other");
  }
  return check_meter_options(options.settings);
}

}  // namespace candela
