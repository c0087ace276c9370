#include "client/cli/options/settings_options.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "client/base/failure.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/picture_options.h"
#include "client/image/color.h"
#include "client/image/write/encodings.h"
#include "client/run/picture_frame.h"
#include "proto/candela/v1/limits.h"
#include "server/base/status_macros.h"
#include "server/base/words.h"

namespace candela {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using v1::format_number;
using v1::SettingField;

// The setting of this path. It must exist; the paths are constants in this file.
const SettingField& setting_at(const std::string& path) {
  const std::vector<SettingField>& fields = v1::setting_fields();
  return *std::find_if(fields.begin(), fields.end(), [&](const SettingField& f) { return f.path == path; });
}

v1::Range<double> range_of(const SettingField& setting) {
  return {setting.declaration().min(), setting.declaration().max()};
}

// ---- Options written by hand ----

absl::Status set_exposure(v1::Exposure& exposure, const std::string& text) {
  const v1::Range<double> ev_range = range_of(setting_at("exposure.manual_ev"));
  exposure.clear_manual_ev();
  exposure.set_mode(v1::Exposure::MODE_AUTO);
  if (absl::EqualsIgnoreCase(text, "auto")) return absl::OkStatus();
  if (!near_words(text, {"auto"}).empty()) {
    return usage_error(absl::StrFormat("--exposure is \"%s\"; did you mean auto? It is auto or an EV, %s",
                                       text, format_range(ev_range)));
  }
  const absl::StatusOr<double> ev = parse_number("--exposure", text, ev_range);
  if (!ev.ok()) return usage_error(absl::StrFormat("%s, or auto", ev.status().message()));
  exposure.set_mode(v1::Exposure::MODE_MANUAL);
  exposure.set_manual_ev(*ev);
  return absl::OkStatus();
}

void add_exposure(CLI::App& app, v1::Settings& settings, const SettingField& setting) {
  v1::Exposure& exposure = *settings.mutable_exposure();
  add_text(app, kExposureSection, "--exposure", "auto|EV",
           absl::StrFormat("%s; %s (default auto)", setting.declaration().help(),
                           format_range(range_of(setting_at("exposure.manual_ev")))),
           [&exposure](const std::string& text) { return set_exposure(exposure, text); });
}

void add_percentiles(CLI::App& app, v1::Settings& settings, const SettingField& setting) {
  v1::Metering& metering = *settings.mutable_exposure()->mutable_metering();
  const v1::Range<double> range = range_of(setting);
  add_text(app, setting.declaration().group(), "--percentiles", "LOW,HIGH",
           absl::StrFormat(
               "Meter between these percentiles of the luminance; implies --metering percentile "
               "(default %s,%s)",
               format_number(setting.declaration().default_()),
               format_number(setting_at("exposure.metering.percentile_high").declaration().default_())),
           [&metering, range](const std::string& text) {
             ASSIGN_OR_RETURN(const auto values, parse_list("--percentiles", text, 2, range));
             if (values[1] - values[0] < v1::kLeastPercentileRange) {
               return usage_error(
                   absl::StrFormat("--percentiles is \"%s\"; the first must be smaller by %s or more", text,
                                   format_number(v1::kLeastPercentileRange)));
             }
             metering.set_statistic(v1::Metering::STATISTIC_PERCENTILE);
             metering.set_percentile_low(values[0]);
             metering.set_percentile_high(values[1]);
             return absl::OkStatus();
           });
}

void add_spot(CLI::App& app, v1::Settings& settings, const SettingField& setting) {
  v1::Metering& metering = *settings.mutable_exposure()->mutable_metering();
  add_text(app, setting.declaration().group(), "--spot", "X0,Y0,X1,Y1",
           "Meter the pixels from X0,Y0 up to but without X1,Y1; implies --weights spot",
           [&metering](const std::string& text) {
             ASSIGN_OR_RETURN(const auto values,
                              parse_list("--spot", text, 4, {0, double{v1::kMaxDimension}}, true));
             metering.set_weights(v1::Metering::WEIGHTS_SPOT);
             v1::Rectangle& spot = *metering.mutable_spot();
             spot.set_x0(static_cast<uint32_t>(values[0]));
             spot.set_y0(static_cast<uint32_t>(values[1]));
             spot.set_x1(static_cast<uint32_t>(values[2]));
             spot.set_y1(static_cast<uint32_t>(values[3]));
             return absl::OkStatus();
           });
}

// Words of primaries that the contract takes as numbers.
std::vector<std::string> other_primaries() {
  std::vector<std::string> words;
  for (const NamedPrimaries& one : named_primaries()) {
    if (*one.word != '\0') words.emplace_back(one.word);
  }
  return words;
}

absl::Status set_primaries(v1::Settings& settings, const std::string& text) {
  settings.clear_input_primaries();
  settings.clear_input_chromaticities();
  for (const NamedPrimaries& one : named_primaries()) {
    if (text.empty() || !absl::EqualsIgnoreCase(text, one.word)) continue;
    *settings.mutable_input_chromaticities() = to_message(one.xy);
    return absl::OkStatus();
  }
  if (!absl::StrContains(text, ',')) {
    ASSIGN_OR_RETURN(const int named, enum_value(*v1::Primaries_descriptor(), "primaries", text));
    settings.set_input_primaries(static_cast<v1::Primaries>(named));
    return absl::OkStatus();
  }
  ASSIGN_OR_RETURN(const auto xy, parse_list("--primaries", text, 8, {-2, 2}));
  std::array<float, 8> values{};
  std::copy(xy.begin(), xy.end(), values.begin());
  *settings.mutable_input_chromaticities() = to_message(values);
  return absl::OkStatus();
}

void add_primaries(CLI::App& app, v1::Settings& settings, const SettingField& setting) {
  add_text(app, setting.declaration().group(), "--primaries", "NAME|XY",
           absl::StrFormat("%s: %s, %s, or the x,y of red, green, blue and white as eight numbers (default: "
                           "the file's, or rec709)",
                           setting.declaration().help(), choice_help(*v1::Primaries_descriptor()),
                           absl::StrJoin(other_primaries(), ", ")),
           [&settings](const std::string& text) { return set_primaries(settings, text); });
}

void add_alpha(CLI::App& app, v1::Settings& settings, const SettingField& setting) {
  add_text(app, setting.declaration().group(), "--alpha", "NAME",
           absl::StrFormat("%s: %s (default: straight for %s, else associated; .jpg has no alpha and shows "
                           "the colour over black)",
                           setting.declaration().help(),
                           absl::StrJoin(v1::enum_words(*v1::Alpha_descriptor()), ", "),
                           extensions_with(&OutputEncoding::has_straight_alpha)),
           [&settings](const std::string& text) {
             const absl::StatusOr<int> value = enum_value(*v1::Alpha_descriptor(), "--alpha", text);
             if (value.ok()) settings.set_alpha(static_cast<v1::Alpha>(*value));
             return value.status();
           });
}

// The light of a colour "#f00" or "#ff0000", as an option takes it; "" for any other text.
std::string light_of_code(absl::string_view text) {
  if (!absl::ConsumePrefix(&text, "#") || (text.size() != 3 && text.size() != 6)) return "";
  const size_t digits = text.size() / 3;
  std::vector<std::string> light;
  for (size_t i = 0; i < 3; ++i) {
    int code = 0;
    if (!absl::SimpleHexAtoi(text.substr(i * digits, digits), &code)) return "";
    const double shown = code / (digits == 1 ? 15.0 : 255.0);
    const double linear = shown <= 0.04045 ? shown / 12.92 : std::pow((shown + 0.055) / 1.055, 2.4);
    light.push_back(absl::StrFormat("%.3g", linear));
  }
  return absl::StrJoin(light, ",");
}

// Parsed after --alpha.
absl::Status set_background(v1::Settings& settings, v1::Range<double> range, const std::string& text) {
  if (const std::string light = light_of_code(text); !light.empty()) {
    return usage_error(absl::StrFormat(
        "--background is \"%s\", a code for a display; it is light, so write --background %s", text, light));
  }
  ASSIGN_OR_RETURN(const auto rgb, parse_list("--background", text, 3, range));
  if (settings.alpha() != v1::ALPHA_UNSPECIFIED && settings.alpha() != v1::ALPHA_OVER) {
    return usage_error(absl::StrFormat("--background needs --alpha over; --alpha %s has no background",
                                       v1::word_of(settings.alpha())));
  }
  settings.set_alpha(v1::ALPHA_OVER);
  v1::Background& background = *settings.mutable_background();
  background.set_red(static_cast<float>(rgb[0]));
  background.set_green(static_cast<float>(rgb[1]));
  background.set_blue(static_cast<float>(rgb[2]));
  return absl::OkStatus();
}

void add_background(CLI::App& app, v1::Settings& settings, const SettingField& setting) {
  const v1::Range<double> range = range_of(setting);
  add_text(
      app, setting.declaration().group(), "--background", "R,G,B",
      absl::StrFormat("Light behind the frame before exposure, linear Rec.709, %s each; implies --alpha over "
                      "(default 0,0,0)",
                      format_range(range)),
      [&settings, range](const std::string& text) { return set_background(settings, range, text); });
}

using AddByHand = void (*)(CLI::App&, v1::Settings&, const SettingField&);
const std::map<std::string, AddByHand> kByHand = {
    {"exposure", add_exposure},  {"percentiles", add_percentiles},
    {"spot", add_spot},          {"primaries", add_primaries},
    {"alpha", add_alpha},        {"background", add_background},
    {"resize", add_size_options}};

// ---- Options made from the declaration ----

// "; 0 .. 10 (default 0.05; conserve: 0 .. 1)"
std::string number_words(const SettingField& setting) {
  const v1::Setting& declaration = setting.declaration();
  std::vector<std::string> parts;
  if (declaration.has_default_()) parts.push_back("default " + format_number(declaration.default_()));
  for (const v1::Setting::Exception& exception : declaration.except()) {
    if (exception.has_default_()) {
      parts.push_back(
          absl::StrFormat("%s: default %s", exception.word(), format_number(exception.default_())));
    }
    if (exception.has_min() || exception.has_max()) {
      parts.push_back(absl::StrFormat("%s: %s", exception.word(), v1::format_range(declaration, exception)));
    }
  }
  return absl::StrCat("; ", v1::format_range(declaration.min(), declaration.max()), parts.empty() ? "" : " (",
                      absl::StrJoin(parts, "; "), parts.empty() ? "" : ")");
}

void add_number_setting(CLI::App& app, const SettingField& setting, Message& holder) {
  const v1::Setting& declaration = setting.declaration();
  const std::string name = "--" + declaration.flag();
  const std::string placeholder =
      declaration.unit().empty() ? "N" : absl::AsciiStrToUpper(declaration.unit());
  add_text(app, declaration.group(), name, placeholder, declaration.help() + number_words(setting),
           [name, &setting, &holder](const std::string& text) {
             const absl::StatusOr<double> value =
                 parse_number(name, text, range_of(setting), setting.is_whole_number());
             if (value.ok()) setting.set_number(holder, *value);
             return value.status();
           });
}

void add_switch(CLI::App& app, const SettingField& setting, Message& holder) {
  const v1::Setting& declaration = setting.declaration();
  const std::string name = "--" + declaration.flag();
  const auto set = [&setting, &holder](bool on) {
    holder.GetReflection()->SetBool(&holder, setting.field, on);
  };
  if (declaration.default_() == 0) {
    app.add_flag_callback(
           name, [set] { set(true); }, declaration.help())
        ->group(declaration.group());
    return;
  }
  add_text(app, declaration.group(), name, "on|off", declaration.help() + " (default on)",
           [name, set](const std::string& text) {
             const absl::StatusOr<bool> on = parse_switch(name, text);
             if (on.ok()) set(*on);
             return on.status();
           });
}

// " (default aces-hill; pq: bt2390)"
std::string default_choice_words(const v1::Setting& declaration) {
  std::vector<std::string> parts;
  if (!declaration.default_word().empty()) parts.push_back("default " + declaration.default_word());
  for (const v1::Setting::Exception& exception : declaration.except()) {
    parts.push_back(absl::StrCat(exception.word(), ": ", exception.default_word()));
  }
  return parts.empty() ? "" : absl::StrCat(" (", absl::StrJoin(parts, "; "), ")");
}

void add_choice(CLI::App& app, const SettingField& setting, Message& holder) {
  const v1::Setting& declaration = setting.declaration();
  const google::protobuf::EnumDescriptor& type = *setting.field->enum_type();
  const std::string words =
      declaration.words().empty() ? choice_help(type) : choice_help(type, v1::words_of(setting));
  add_text(app, declaration.group(), "--" + declaration.flag(), "NAME",
           absl::StrFormat("%s: %s%s", declaration.help(), words, default_choice_words(declaration)),
           [&setting, &type, &holder](const std::string& word) {
             const absl::StatusOr<int> value = enum_value(type, setting.declaration().flag(), word);
             if (value.ok()) holder.GetReflection()->SetEnumValue(&holder, setting.field, *value);
             return value.status();
           });
}

void add_word(CLI::App& app, const SettingField& setting, Message& holder) {
  const v1::Setting& declaration = setting.declaration();
  add_text(app, declaration.group(), "--" + declaration.flag(), "NAME",
           absl::StrFormat("%s (default %s)", declaration.help(), declaration.default_word()),
           [&setting, &holder](const std::string& text) {
             holder.GetReflection()->SetString(&holder, setting.field, absl::AsciiStrToLower(text));
             return absl::OkStatus();
           });
}

void add_setting(CLI::App& app, const SettingField& setting, v1::Settings& settings) {
  Message& holder = setting.holder(settings);
  if (setting.is_number()) return add_number_setting(app, setting, holder);
  switch (setting.field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_BOOL:
      return add_switch(app, setting, holder);
    case FieldDescriptor::CPPTYPE_ENUM:
      return add_choice(app, setting, holder);
    default:
      return add_word(app, setting, holder);
  }
}

}  // namespace

bool changes_metering(const SettingField& setting) {
  return setting.declaration().group() == "Input" || absl::StartsWith(setting.path, "exposure.") ||
         setting.path == "tier" || setting.path == "alpha";
}

void add_settings_options(CLI::App& app, v1::Settings& settings, const SettingFilter& filter) {
  for (const SettingField& setting : v1::setting_fields()) {
    const std::string& flag = setting.declaration().flag();
    if (flag.empty() || !filter(setting)) continue;
    const auto by_hand = kByHand.find(flag);
    if (by_hand == kByHand.end()) {
      add_setting(app, setting, settings);
    } else if (app.get_option_no_throw("--" + flag) == nullptr) {  // several settings share some of them
      by_hand->second(app, settings, setting);
    }
  }
}

absl::Status check_settings_options(const v1::Settings& settings) {
  if (!settings.tier().empty() && settings.has_max_error_codes()) {
    return usage_error("--max-error chooses the tier that --tier names; give only one of the two");
  }
  RETURN_IF_ERROR(check_size_options(settings));
  const v1::Metering& metering = settings.exposure().metering();
  if (metering.weights() == v1::Metering::WEIGHTS_SPOT && !metering.has_spot()) {
    return usage_error("--weights spot needs --spot X0,Y0,X1,Y1");
  }
  v1::Settings completed;  // only the exposure: parsing has checked it, so completing it cannot fail
  *completed.mutable_exposure() = settings.exposure();
  RETURN_IF_ERROR(v1::complete_settings(completed));
  const double min = completed.exposure().min_exposure();
  const double max = completed.exposure().max_exposure();
  if (min <= max) return absl::OkStatus();
  return usage_error(
      absl::StrFormat("--min-exposure %s is above --max-exposure %s; give both so that it is not",
                      format_number(min), format_number(max)));
}

}  // namespace candela
