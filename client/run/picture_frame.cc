#include "client/run/picture_frame.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <numbers>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "client/image/color.h"
#include "client/image/power.h"
#include "client/image/read/signal.h"
#include "client/run/embedded_server.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"
#include "server/encode/color_words.h"

namespace candela {
namespace {

// How much wider than the frame's the image's pixels are, so that it shows the frame's shape. 1 if only
// rounding to whole pixels changes it.
double squeeze(v1::ImageSize frame, const v1::OutputSize& asked) {
  const double width = asked.width(), height = asked.height();
  if (width == 0 || height == 0 || asked.has_pixel_aspect()) return 1;
  const double aspect = static_cast<double>(frame.width) / frame.height;
  const bool fits = std::fabs(width - height * aspect) <= 0.5 || std::fabs(height - width / aspect) <= 0.5;
  return fits ? 1 : aspect * height / width;
}

}  // namespace

std::string desqueeze(const Image& frame, v1::Settings& settings) {
  const double aspect = frame.pixel_aspect;
  if (aspect == 1) return "--desqueeze changes nothing: the file's pixels are square";
  if (aspect < v1::kPixelAspect.min || aspect > v1::kPixelAspect.max) {
    return absl::StrFormat(
        "--desqueeze changes nothing: the file's pixel aspect of %s is not within %s .. %s",
        in_digits(aspect, 6), in_digits(v1::kPixelAspect.min, 6), in_digits(v1::kPixelAspect.max, 6));
  }
  settings.mutable_output_size()->set_pixel_aspect(aspect);
  return absl::StrFormat("--desqueeze made square pixels of the file's, whose aspect is %s",
                         in_digits(aspect, 6));
}

double image_pixel_aspect(v1::ImageSize frame, double pixel_aspect, const v1::OutputSize& asked) {
  return asked.has_pixel_aspect() ? 1 : pixel_aspect * squeeze(frame, asked);
}

std::string shape_note(v1::ImageSize frame, const v1::OutputSize& asked) {
  const double by = squeeze(frame, asked);
  if (by == 1) return "";
  return absl::StrFormat(
      "--resize %dx%d changes the shape of %dx%d: the image's pixels have %s times the frame's aspect; "
      "--resize %dx keeps the shape",
      asked.width(), asked.height(), frame.width, frame.height, in_digits(by, 4), asked.width());
}

std::string size_words(v1::ImageSize image, v1::ImageSize frame) {
  const std::string words = absl::StrFormat("%dx%d", image.width, image.height);
  return image == frame ? words : absl::StrFormat("%s of %dx%d", words, frame.width, frame.height);
}

namespace {

float to_float(float component) { return component; }
float to_float(uint16_t component) { return imath_half_to_float(component); }

// Whether alpha is 0 or less everywhere although there is light. NaN counts as 0, as in ingest.
template <typename Component>
bool alpha_is_empty(const Image& frame) {
  bool light = false;
  Component texel[4];
  for (uint64_t at = 0; at < frame.bytes(); at += sizeof texel) {
    std::memcpy(texel, frame.pixels.data() + at, sizeof texel);
    if (to_float(texel[3]) > 0.0f) return false;
    for (int k = 0; k < 3 && !light; ++k) light = std::abs(to_float(texel[k])) > 0.0f;
  }
  return light;
}

}  // namespace

std::string ignore_empty_alpha(const Image& frame, v1::Settings& settings) {
  if (!frame.has_alpha) return "";
  const bool floats = frame.format == ImageFormat::kRgba32f;
  if (!(floats ? alpha_is_empty<float>(frame) : alpha_is_empty<uint16_t>(frame))) return "";
  settings.set_alpha(v1::ALPHA_IGNORE);
  return "alpha ignored: it is 0 everywhere and would hide the whole picture; --alpha straight uses it";
}

namespace {

std::array<float, 8> xy_of(v1::Primaries primaries) {
  const char* name = primaries == v1::PRIMARIES_REC2020    ? "Rec.2020"
                     : primaries == v1::PRIMARIES_P3_D65   ? "P3-D65"
                     : primaries == v1::PRIMARIES_ACES_AP0 ? "AP0"
                     : primaries == v1::PRIMARIES_ACES_AP1 ? "AP1"
                     : primaries == v1::PRIMARIES_XYZ      ? kXyz.name
                                                           : kRec709.name;
  for (const NamedPrimaries& known : named_primaries()) {
    if (known.name == absl::string_view(name)) return known.xy;
  }
  return kRec709.xy;
}

}  // namespace

PrimariesUsed primaries_used(const Image& image, const v1::Settings& given) {
  using Source = PrimariesUsed::Source;
  if (given.has_input_chromaticities()) {
    const v1::Chromaticities& c = given.input_chromaticities();
    return {
        Source::kOption,
        {c.red_x(), c.red_y(), c.green_x(), c.green_y(), c.blue_x(), c.blue_y(), c.white_x(), c.white_y()}};
  }
  if (given.input_primaries() != v1::PRIMARIES_UNSPECIFIED) {
    return {Source::kOption, xy_of(given.input_primaries())};
  }
  return {image.names_primaries ? Source::kFile : Source::kAssumed,
          image.chromaticities.value_or(kRec709.xy)};
}

std::string words_of(const PrimariesUsed& primaries) {
  if (primaries.source == PrimariesUsed::Source::kValues) return "the file's own values";
  if (primaries.source == PrimariesUsed::Source::kView) return primaries.space + ", from --ocio-input";
  const NamedPrimaries* known = find_primaries(primaries.xy);
  const char* from = primaries.source == PrimariesUsed::Source::kFile     ? "from the file"
                     : primaries.source == PrimariesUsed::Source::kOption ? "from --primaries"
                                                                          : "assumed";
  return absl::StrCat(known != nullptr ? known->name : "primaries " + xy_words(primaries.xy), ", ", from);
}

nlohmann::ordered_json to_json(const PrimariesUsed& primaries) {
  if (primaries.source == PrimariesUsed::Source::kValues) {
    return {{"name", nullptr}, {"xy", nullptr}, {"from", "values"}};
  }
  if (primaries.source == PrimariesUsed::Source::kView) {
    return {{"name", primaries.space}, {"xy", nullptr}, {"from", "ocio-input"}};
  }
  const NamedPrimaries* known = find_primaries(primaries.xy);
  const char* from = primaries.source == PrimariesUsed::Source::kFile     ? "file"
                     : primaries.source == PrimariesUsed::Source::kOption ? "option"
                                                                          : "assumed";
  nlohmann::ordered_json name;
  if (known != nullptr) name = known->name;
  return {{"name", name}, {"xy", primaries.xy}, {"from", from}};
}

namespace {

constexpr double kNotedShare = 0.01;

// Light outside of ACES AP1, the largest gamut that a curve has.
constexpr char kCheck[] =
    "no display shows them; if the picture should have none, name the file's primaries with --primaries";

// Tells the user how to keep the colours.
const char* advice(const v1::Settings& settings) {
  switch (settings.curve()) {
    case v1::TONE_CURVE_ACES_1:
    case v1::TONE_CURVE_ACES_2:
      return kCheck;
    case v1::TONE_CURVE_TABLE:
      return settings.table().axes() == v1::ColorTable::AXES_REC709 ? "the view works on Rec.709's channels"
                                                                    : kCheck;
    case v1::TONE_CURVE_UNSPECIFIED:
    case v1::TONE_CURVE_ACES_HILL:
    case v1::TONE_CURVE_AGX:
      return "--curve aces-2 keeps all of ACES AP1";
    default:
      return "the curve works on Rec.709's channels; --curve aces-2 keeps all of ACES AP1";
  }
}

}  // namespace

std::optional<std::string> gamut_note(const v1::ResultHeader& result, const v1::Settings& settings,
                                      PictureLight light, bool names_primaries) {
  const double components = 3.0 * result.width() * result.height();
  const double share = static_cast<double>(result.gamut_cut_components()) / components;
  const bool finished = light == PictureLight::kSdr && settings.curve() == v1::TONE_CURVE_LINEAR;
  if (!(share > (finished ? 0 : kNotedShare))) return std::nullopt;
  const std::string cut = in_digits(100.0 * share, 2) + " % of the colour components lie outside ";
  if (!finished) return absl::StrCat(cut, "the curve's gamut and were cut; ", advice(settings));
  return absl::StrCat(
      cut, "Rec.709 and were cut",
      names_primaries ? ""
                      : "; an image of its own, a .png, .jpg, .tif or .avif, keeps the picture's primaries");
}

std::string held_words(double target, double target_before_limits) {
  if (target_before_limits == 0 || target == target_before_limits) return "";
  const bool above = target < target_before_limits;
  return absl::StrFormat("exposure held at %s %s; it would have been %s%s",
                         above ? "--max-exposure" : "--min-exposure", v1::format_number(target),
                         in_digits(target_before_limits, 4),
                         above ? "; --ignore-below 0.01 leaves a black background out of the metering" : "");
}

std::string bad_values_note(uint64_t nan, uint64_t infinite, uint64_t clamped) {
  std::vector<std::string> words;
  if (nan + infinite > 0) {
    words.push_back(
        absl::StrFormat("%d NaN and %d infinite components were taken as 0 and +-65504", nan, infinite));
  }
  if (clamped > 0) {
    words.push_back(absl::StrFormat("%d component%s beyond 2^30, the most that is rendered, %s cut to that",
                                    clamped, clamped == 1 ? "" : "s", clamped == 1 ? "was" : "were"));
  }
  return absl::StrJoin(words, "; ");
}

std::string cube_map_note(const Image& image) {
  if (!image.is_cube_map) return "";
  return "the file is a cube map (envmap): its faces are rendered as they lie in it; candela view and "
         "candela environment show what they surround";
}

namespace {

ImageFormat image_format(v1::OutputFormat format) {
  return format == v1::OUTPUT_FORMAT_RGBA16F  ? ImageFormat::kRgba16f
         : format == v1::OUTPUT_FORMAT_RGBA16 ? ImageFormat::kRgba16
                                              : ImageFormat::kRgba8;
}

// Whether any field has a value. A message within counts only if one of its own fields has one.
bool sets_a_field(const google::protobuf::Message& message) {
  std::vector<const google::protobuf::FieldDescriptor*> set;
  const google::protobuf::Reflection& reflection = *message.GetReflection();
  reflection.ListFields(message, &set);
  return std::ranges::any_of(set, [&](const google::protobuf::FieldDescriptor* field) {
    return field->cpp_type() != google::protobuf::FieldDescriptor::CPPTYPE_MESSAGE ||
           sets_a_field(reflection.GetMessage(message, field));
  });
}

}  // namespace

bool has_primaries(const v1::Settings& settings) {
  return settings.has_input_chromaticities() || settings.input_primaries() != v1::PRIMARIES_UNSPECIFIED;
}

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

v1::PixelFormat wire_format(ImageFormat format) {
  return format == ImageFormat::kRgba16f ? v1::PIXEL_FORMAT_RGBA16F : v1::PIXEL_FORMAT_RGBA32F;
}

ImageLimits image_limits(const v1::Limits& server, const PictureOptions& options) {
  ImageLimits limits = default_image_limits();
  limits.max_dimension = server.max_dimension();
  limits.max_bytes = server.max_frame_bytes();
  limits.max_pixels = options.max_pixels;
  if (options.max_chunk_mib > 0) limits.max_chunk_bytes = options.max_chunk_mib << 20;
  return limits;
}

ImageLimits default_image_limits() { return {.max_chunk_bytes = EmbeddedServer::usable_memory_bytes() / 8}; }

FrameView view_of(const Image& image) {
  return {.width = image.width,
          .height = image.height,
          .format = wire_format(image.format),
          .pixels = image.pixels.span()};
}

namespace {

// The peak of the display that the settings describe, in nit.
double display_nits(v1::Settings settings) {
  if (!is_hdr(encoded_transfer(settings))) return kReferenceWhiteNits;
  (void)v1::complete_settings(settings);  // parsing has checked them
  return settings.peak_nits();
}

// The curve of a picture whose exposed light goes up to `nits`: none if the display can show all of it.
void choose_curve(double nits, v1::Settings& settings) {
  constexpr double kRoundings = 1.001, kMostNits = 10000;  // of a peak that a file says
  const double display = display_nits(settings);
  if (settings.curve() == v1::TONE_CURVE_UNSPECIFIED) {
    const bool shows_all = nits <= kRoundings * display && !settings.has_source_peak_nits();
    settings.set_curve(shows_all                            ? v1::TONE_CURVE_LINEAR
                       : is_hdr(encoded_transfer(settings)) ? v1::TONE_CURVE_BT2390
                                                            : v1::TONE_CURVE_SHOULDER);
  }
  const bool has_source =
      settings.curve() == v1::TONE_CURVE_BT2390 || settings.curve() == v1::TONE_CURVE_SHOULDER;
  if (!has_source || settings.has_source_peak_nits()) return;
  settings.set_source_peak_nits(std::clamp(nits, display, kMostNits));
}

bool is_grey(const v1::Background& c) { return c.red() == c.green() && c.green() == c.blue(); }

// Whether the pipeline treats R, G and B alike, whatever their primaries are.
bool treats_channels_alike(const v1::Settings& settings, bool exposure_given) {
  return settings.curve() == v1::TONE_CURVE_LINEAR && !is_hdr(encoded_transfer(settings)) &&
         (exposure_given || settings.exposure().mode() == v1::Exposure::MODE_MANUAL) &&
         settings.bloom().has_intensity() && settings.bloom().intensity() == 0 &&
         !settings.has_white_balance() && is_grey(settings.background());
}

}  // namespace

PictureDefaults show_as_it_is(PictureLight light, double peak, const PictureFacts& facts,
                              v1::Settings& settings) {
  PictureDefaults defaults = facts.defaults;
  if (light == PictureLight::kScene) return defaults;
  defaults.light = light;
  v1::Exposure& exposure = *settings.mutable_exposure();
  if (!facts.exposure && !facts.adapts && exposure.mode() == v1::Exposure::MODE_UNSPECIFIED) {
    exposure.set_mode(v1::Exposure::MODE_MANUAL);
    exposure.set_manual_ev(0);
    defaults.exposure = true;
  }
  if (!sets_a_field(settings.bloom())) {
    settings.mutable_bloom()->set_intensity(0);
    defaults.bloom = true;
  }
  const double ev = exposure.mode() == v1::Exposure::MODE_MANUAL ? exposure.manual_ev() : 0;
  const double exposed = facts.exposure.value_or(exponential(std::numbers::ln2 * ev));
  choose_curve((light == PictureLight::kSdr ? 1 : peak * exposed) * kReferenceWhiteNits, settings);
  return defaults;
}

absl::Status check_light_for_gain_map(const std::string& path, PictureLight light, bool asked) {
  if (light != PictureLight::kSdr || !asked) return absl::OkStatus();
  return input_failure(
      absl::InvalidArgumentError(absl::StrCat(path,
                                              ": it is an SDR picture, which has no light for the gain map "
                                              "of --gain-map; --scene-light takes it as a "
                                              "scene's light")),
      path);
}

PictureSettings settings_for(const Image& image, const v1::Settings& given, const PictureFacts& facts) {
  PictureSettings made{.settings = given, .defaults = {}, .kept_primaries = {}};
  made.defaults = show_as_it_is(image.light, image.peak, facts, made.settings);
  const bool keeps = image.light == PictureLight::kSdr && facts.names_primaries &&
                     treats_channels_alike(made.settings, facts.exposure.has_value());
  if (has_primaries(given)) {
    const NamedPrimaries* const named = find_primaries(primaries_used(image, given).xy);
    if (!keeps || named == nullptr || named->xy == kRec709.xy || named->xy == kXyz.xy) return made;
    made.kept_primaries = named->xy;
    made.settings.clear_input_primaries();
    made.settings.clear_input_chromaticities();
  } else if (image.chromaticities && keeps) {
    made.kept_primaries = image.chromaticities;
  } else if (image.chromaticities) {
    *made.settings.mutable_input_chromaticities() = to_message(*image.chromaticities);
  }
  return made;
}

std::string not_metered_note(const Image& image, const v1::Settings& given, const PictureDefaults& defaults) {
  v1::Exposure asked = given.exposure();
  asked.clear_mode();
  if (image.light == PictureLight::kScene || !defaults.exposure || !sets_a_field(asked)) return "";
  return absl::StrFormat(
      "an %s picture is shown at 0 EV, so the options of metering change nothing; --exposure auto meters it",
      image.light == PictureLight::kSdr ? "SDR" : "HDR");
}

Image picture_of(RenderResult result, bool has_alpha, double pixel_aspect) {
  Image picture;
  picture.width = result.header.width();
  picture.height = result.header.height();
  picture.format = image_format(result.header.format());
  picture.pixels = PixelBuffer(std::move(result.data), result.bytes);
  picture.has_alpha = has_alpha;
  picture.pixel_aspect = pixel_aspect;
  return picture;
}

WriteOptions write_options_for(WriteOptions options, const v1::ResultHeader& result,
                               const std::optional<std::array<float, 8>>& kept_primaries) {
  options.primaries = kept_primaries;
  options.hdr.max_light_nits = result.max_light_nits();
  options.hdr.mean_light_nits = result.mean_light_nits();
  options.gain_map_max_log2 = result.gain_map_max_log2();
  return options;
}

absl::Status name_file(const absl::Status& status, const std::string& path) {
  if (absl::IsUnavailable(status) || absl::IsDeadlineExceeded(status)) return about_input(status, path);
  return about_input(reworded(status, absl::StrFormat("%s: %s", path, status.message())), path);
}

PrimariesUsed primaries_of(const Image& image, const v1::Settings& given, const BakedView* view) {
  PrimariesUsed used = primaries_used(image, given);
  if (view != nullptr && view->view.as_is) used.source = PrimariesUsed::Source::kValues;
  if (view != nullptr && !view->view.as_is && view->view.show_input) {
    used.source = PrimariesUsed::Source::kView;
    used.space = view->view.input;
  }
  return used;
}

}  // namespace candela
