#include "client/cli/render_options.h"

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/cli/option_kinds.h"
#include "client/cli/usage.h"
#include "client/image/image.h"

namespace candela {
namespace {

constexpr char kExposure[] = "Exposure";
constexpr char kBloom[] = "Bloom";
constexpr char kTone[] = "Tone";
constexpr char kOutput[] = "Output";
constexpr char kServer[] = "Server";

constexpr v1::Range<double> kJpegQuality{1, 100};

// The wire's defaults, see render.proto.
constexpr v1::ToneCurve kDefaultCurve = v1::TONE_CURVE_ACES_HILL;
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
  add_text(app, kExposure, "--exposure", "auto|EV",
           absl::StrFormat("Metered, or fixed at 2^EV; %s (default auto)", format_range(v1::kManualEv)),
           [&exposure](const std::string& text) { return set_exposure(exposure, text); });
  add_number(app, kExposure, "--compensation", "EV", v1::kCompensationEv, v1::kDefaultCompensationEv,
             "Added to the metered exposure", [&exposure](double ev) { exposure.set_compensation_ev(ev); });
  add_number(app, kExposure, "--key", "X", v1::kKey, v1::kDefaultKey, "What the metered mean is brought to",
             [&exposure](double key) { exposure.set_key(key); });
  add_number(app, kExposure, "--min-exposure", "X", v1::kExposureLimit, v1::kDefaultMinExposure,
             "Least factor that metering gives", [&exposure](double x) { exposure.set_min_exposure(x); });
  add_number(app, kExposure, "--max-exposure", "X", v1::kExposureLimit, v1::kDefaultMaxExposure,
             "Largest factor that metering gives", [&exposure](double x) { exposure.set_max_exposure(x); });
}

void add_bloom_options(CLI::App& app, v1::Bloom& bloom) {
  add_number(app, kBloom, "--bloom-intensity", "X", v1::kBloomIntensity, v1::kDefaultBloomIntensity,
             "Factor on the bloom, 0 for none",
             [&bloom](double x) { bloom.set_intensity(static_cast<float>(x)); });
  add_number(app, kBloom, "--bloom-threshold", "L", v1::kBloomThreshold, v1::kDefaultBloomThreshold,
             "Scene luminance above which pixels bloom",
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

void add_tone_options(CLI::App& app, v1::Settings& settings) {
  add_enum<v1::ToneCurve>(app, kTone, "--curve", "curve", kDefaultCurve, "Tone curve",
                          [&settings](v1::ToneCurve curve) { settings.set_curve(curve); });
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
  add_enum<v1::BadValues>(app, kTone, "--bad-values", "policy for bad values", kDefaultBadValues,
                          "What to do with NaN and Inf",
                          [&settings](v1::BadValues policy) { settings.set_bad_values(policy); });
}

void add_output_options(CLI::App& app, RenderArguments& arguments) {
  add_text(app, kOutput, "--bits", "8|16", "Bits a component of a .png (default 8)",
           [&arguments](const std::string& text) {
             if (text != "8" && text != "16") {
               return usage_error(absl::StrFormat("--bits is \"%s\"; it must be 8 or 16", text));
             }
             arguments.bits = text == "8" ? 8 : 16;
             return absl::OkStatus();
           });
  add_number(
      app, kOutput, "--quality", "N", kJpegQuality, WriteOptions().jpeg_quality, "Quality of a .jpg",
      [&arguments](double n) { arguments.quality = static_cast<int>(n); }, true);
  add_json_option(app, kOutput, "Write what was done as one line of JSON, - for stdout",
                  arguments.options.json);
  app.add_flag("--quiet,-q", arguments.options.quiet, "Print nothing but errors")->group(kOutput);
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

void add_server_options(CLI::App& app, ServerChoice& choice) {
  add_text(app, kServer, "--server", "ADDRESS",
           "A running candelad, HOST:PORT or unix:PATH (default: none, a server inside this process)",
           [&choice](const std::string& address) {
             choice.address = address;
             return absl::OkStatus();
           });
  add_text(app, kServer, "--device", "NAME|INDEX",
           "Device of the server inside: a part of its name, or its number (default: the best there is)",
           [&choice](const std::string& device) {
             choice.device = device;
             return absl::OkStatus();
           });
}

absl::Status check_server_options(const ServerChoice& choice) {
  if (choice.address.empty() || choice.device.empty()) return absl::OkStatus();
  return usage_error("--device is for rendering without --server, which has its own; give one of them");
}

void add_json_option(CLI::App& app, const std::string& section, const std::string& help, std::string& path) {
  add_text(app, section, "--json", "FILE|-", help, [&path](const std::string& text) {
    path = text;
    return absl::OkStatus();
  });
}

void add_render_options(CLI::App& app, RenderArguments& arguments) {
  RenderOptions& options = arguments.options;
  app.add_option("IN", options.input, "Image to render: OpenEXR, Radiance .hdr or PFM")
      ->required()
      ->option_text(" ");
  app.add_option("OUT", options.output, "File to write: .png, .jpg, .exr (half floats) or .pfm")
      ->required()
      ->option_text(" ");
  add_exposure_options(app, *options.settings.mutable_exposure());
  add_bloom_options(app, *options.settings.mutable_bloom());
  add_tone_options(app, options.settings);
  add_output_options(app, arguments);
  add_server_options(app, options.server);
}

absl::Status finish_render_options(RenderArguments& arguments) {
  RenderOptions& options = arguments.options;
  const absl::StatusOr<OutputKind> kind = output_kind(options.output);
  if (!kind.ok()) return usage_error(std::string(kind.status().message()));
  const bool encoded = *kind == OutputKind::kPng || *kind == OutputKind::kJpeg;
  if (arguments.bits == 16 && *kind != OutputKind::kPng) {
    return usage_error(absl::StrFormat("--bits 16 is for .png; %s has its own depth", options.output));
  }
  if (arguments.quality != 0 && *kind != OutputKind::kJpeg) {
    return usage_error(absl::StrFormat("--quality is for .jpg; %s loses nothing", options.output));
  }
  if (!encoded && options.settings.transfer() != v1::TRANSFER_UNSPECIFIED) {
    options.notes.push_back(
        absl::StrFormat("--transfer changes nothing: %s holds display-linear light", options.output));
  }
  options.settings.set_output_format(!encoded               ? v1::OUTPUT_FORMAT_RGBA16F
                                     : arguments.bits == 16 ? v1::OUTPUT_FORMAT_RGBA16
                                                            : v1::OUTPUT_FORMAT_RGBA8);
  options.write.transfer = encoded_transfer(options.settings.transfer());
  if (arguments.quality != 0) options.write.jpeg_quality = arguments.quality;
  absl::Status status = check_exposure_limits(options.settings.exposure());
  status.Update(check_server_options(options.server));
  return status;
}

}  // namespace candela
