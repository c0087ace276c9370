#include "client/cli/options/option_kinds.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "absl/algorithm/container.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "candela/v1/render.pb.h"
#include "client/base/failure.h"
#include "proto/candela/v1/settings.h"
#include "server/base/words.h"

namespace candela {
namespace {

using google::protobuf::EnumDescriptor;

// Another name for one of an enum's words.
struct OtherName {
  const EnumDescriptor* (*type)();
  const char* name;
  const char* word;
};
constexpr OtherName kOtherNames[] = {
    {v1::Primaries_descriptor, "srgb", "rec709"},       {v1::Primaries_descriptor, "linear-srgb", "rec709"},
    {v1::Primaries_descriptor, "bt709", "rec709"},      {v1::Primaries_descriptor, "bt2020", "rec2020"},
    {v1::Primaries_descriptor, "display-p3", "p3-d65"}, {v1::Primaries_descriptor, "aces2065-1", "aces-ap0"},
    {v1::Primaries_descriptor, "ap0", "aces-ap0"},      {v1::Primaries_descriptor, "acescg", "aces-ap1"},
    {v1::Primaries_descriptor, "ap1", "aces-ap1"},
};

// Words that people try, and what does what they mean.
struct Instead {
  const EnumDescriptor* (*type)();
  std::vector<std::string> typed;
  const char* words;
};
const Instead kInstead[] = {
    {v1::Bloom::Kind_descriptor, {"none", "off", "no", "0"}, "--bloom-intensity 0 turns bloom off."},
    {v1::Metering::Statistic_descriptor, {"none", "off", "no"}, "--exposure EV fixes the exposure."},
    {v1::ToneCurve_descriptor, {"none", "off", "no"}, "linear only cuts light at 0 and 1."},
    {v1::ToneCurve_descriptor, {"srgb", "gamma22"}, "--transfer chooses the display encoding."},
    {v1::Alpha_descriptor, {"none", "off", "no", "opaque"}, "ignore takes every pixel as opaque."},
    {v1::Alpha_descriptor, {"premultiplied", "premult"}, "associated is that."},
    {v1::Alpha_descriptor, {"unassociated", "unpremultiplied"}, "straight is that."},
    {v1::Transfer_descriptor, {"none", "off", "no"}, "linear writes light as it is."},
};

// The names of the value `word` that are not its own.
std::vector<std::string> other_names(const EnumDescriptor& type, const std::string& word) {
  std::vector<std::string> names;
  for (const OtherName& other : kOtherNames) {
    if (other.type() == &type && other.word == word) names.emplace_back(other.name);
  }
  return names;
}

absl::Status unknown_choice(const EnumDescriptor& type, const std::string& what, const std::string& word) {
  const std::string typed = folded(word);
  std::vector<std::string> names;
  for (const std::string& own : choice_words(type)) {
    names.push_back(own);
    for (std::string& other : other_names(type, own)) names.push_back(std::move(other));
  }
  std::string hint = did_you_mean(near_words(word, names));
  for (const Instead& instead : kInstead) {
    if (instead.type() != &type) continue;
    if (std::find(instead.typed.begin(), instead.typed.end(), typed) != instead.typed.end()) {
      hint = instead.words;
    }
  }
  return usage_error(absl::StrFormat("unknown %s \"%s\"; %s %s", what, word,
                                     hint.empty() ? "there are:" : hint + " There are:", choice_help(type)));
}

}  // namespace

std::vector<std::string> choice_words(const EnumDescriptor& type) {
  std::vector<std::string> words = v1::enum_words(type);
  // --ocio makes the table, so a user cannot choose that curve by name.
  if (&type == v1::ToneCurve_descriptor()) std::erase(words, v1::word_of(v1::TONE_CURVE_TABLE));
  // `candela meter` is the command that makes no image.
  if (&type == v1::Encoding_descriptor()) std::erase(words, v1::word_of(v1::ENCODING_NONE));
  return words;
}

std::string choice_help(const EnumDescriptor& type) { return choice_help(type, choice_words(type)); }

std::string choice_help(const EnumDescriptor& type, std::vector<std::string> words) {
  for (std::string& word : words) {
    const std::vector<std::string> others = other_names(type, word);
    if (!others.empty()) absl::StrAppend(&word, " (", absl::StrJoin(others, ", "), ")");
  }
  return absl::StrJoin(words, ", ");
}

absl::StatusOr<int> enum_value(const EnumDescriptor& type, const std::string& what, const std::string& word) {
  std::string typed = folded(word);
  for (const OtherName& other : kOtherNames) {
    if (other.type() == &type && folded(other.name) == typed) typed = folded(other.word);
  }
  const std::vector<std::string> words = choice_words(type);
  for (int i = 0; i < type.value_count(); ++i) {
    const std::string own = v1::enum_word(type, type.value(i)->number());
    const bool may = std::find(words.begin(), words.end(), own) != words.end();
    if (may && folded(own) == typed) return type.value(i)->number();
  }
  return unknown_choice(type, what, word);
}

CLI::Option* add_text(CLI::App& app, const std::string& section, const std::string& name,
                      const std::string& placeholder, const std::string& help,
                      std::function<absl::Status(const std::string&)> set) {
  const auto take = [name, set = std::move(set)](const std::string& text) {
    absl::Status status = text.empty() ? empty_value(name) : set(text);
    if (!status.ok()) throw OptionError{std::move(status)};
  };
  return app.add_option_function<std::string>(name, take, help)
      ->option_text(placeholder)
      ->group(section)
      ->take_last();
}

CLI::Option* add_text(CLI::App& app, const std::string& section, const std::string& name,
                      const std::string& placeholder, const std::string& help, std::string& text) {
  return add_text(app, section, name, placeholder, help, [&text](const std::string& typed) {
    text = typed;
    return absl::OkStatus();
  });
}

namespace {

// Whether numbers of the option have this unit.
bool is_own_unit(const std::string& name, const std::string& unit) {
  constexpr std::pair<const char*, const char*> kUnits[] = {
      {"--white-balance", "K"}, {"--exposure", "EV"}, {"--compensation", "EV"}, {"--fov", "deg"},
      {"--yaw", "deg"},         {"--pitch", "deg"},   {"--roll", "deg"},        {"--turn", "deg"}};
  return absl::c_any_of(kUnits, [&](const auto& own) {
    return name == own.first && absl::EqualsIgnoreCase(absl::StripLeadingAsciiWhitespace(unit), own.second);
  });
}

// What somebody means who writes a number with a unit, with a comma or as an illuminant; "" if that is
// unknown.
std::string meant_number(const std::string& name, const std::string& text) {
  constexpr std::pair<const char*, int> kIlluminants[] = {
      {"A", 2856}, {"D50", 5003}, {"D55", 5503}, {"D65", 6504}, {"D75", 7504}};
  for (const auto& [word, kelvin] : kIlluminants) {
    if (name == "--white-balance" && absl::EqualsIgnoreCase(text, word)) {
      return absl::StrFormat("; for %s write %d", word, kelvin);
    }
  }
  double value = 0;
  const size_t end = text.find_last_of("0123456789.") + 1;  // 0 if there is none
  const std::string number = text.substr(0, end);
  const bool has_unit = end > 0 && text.find_first_of("0123456789,") != std::string::npos;
  if (has_unit && absl::SimpleAtod(number, &value) && std::isfinite(value)) {
    const std::string unit = text.substr(end);
    const bool is_kelvin = name == "--white-balance" && unit == "K";
    for (const auto& [prefix, factor] : {std::pair("k", 1e3), std::pair("K", 1e3), std::pair("M", 1e6)}) {
      if (unit == prefix && !is_kelvin)
        return absl::StrFormat("; write %s", v1::format_number(value * factor));
    }
    return is_own_unit(name, unit) ? absl::StrFormat("; write %s, without a unit", number)
                                   : "; write a number without a unit, in the unit that --help names";
  }
  const std::string with_point = absl::StrReplaceAll(text, {{",", "."}});
  if (with_point != text && absl::SimpleAtod(with_point, &value)) {
    return absl::StrFormat("; write %s, with a point", with_point);
  }
  return "";
}

}  // namespace

std::string format_range(v1::Range<double> range) { return v1::format_range(range.min, range.max); }

absl::StatusOr<double> parse_number(const std::string& name, const std::string& text, v1::Range<double> range,
                                    bool whole) {
  double value = 0;
  if (!absl::SimpleAtod(text, &value) || std::isnan(value)) {
    return usage_error(absl::StrFormat("%s is \"%s\", which is not a number; it must be %s%s", name, text,
                                       format_range(range), meant_number(name, text)));
  }
  if (value < range.min || value > range.max || (whole && value != std::floor(value))) {
    return usage_error(absl::StrFormat("%s is %s; it must be %s%s", name, text,
                                       whole ? "a whole number, " : "", format_range(range)));
  }
  return value;
}

absl::StatusOr<std::vector<double>> parse_list(const std::string& name, const std::string& text, size_t count,
                                               v1::Range<double> range, bool whole) {
  const std::vector<std::string> parts = absl::StrSplit(text, ',');
  if (parts.size() != count) {
    return usage_error(
        absl::StrFormat("%s is \"%s\"; it must be %d numbers separated by commas", name, text, count));
  }
  std::vector<double> values;
  for (const std::string& part : parts) {
    const absl::StatusOr<double> value = parse_number(name, part, range, whole);
    if (!value.ok()) return usage_error(std::string(value.status().message()));
    values.push_back(*value);
  }
  return values;
}

absl::StatusOr<bool> parse_switch(const std::string& name, const std::string& text) {
  if (absl::EqualsIgnoreCase(text, "on")) return true;
  if (absl::EqualsIgnoreCase(text, "off")) return false;
  return usage_error(absl::StrFormat("%s is \"%s\"; it must be on or off", name, text));
}

void add_number(CLI::App& app, const std::string& section, const std::string& name, const std::string& unit,
                v1::Range<double> range, double initial, const std::string& help,
                std::function<void(double)> set, bool whole) {
  const std::string text =
      absl::StrFormat("%s; %s (default %s)", help, format_range(range), v1::format_number(initial));
  add_text(app, section, name, unit, text,
           [name, range, whole, set = std::move(set)](const std::string& typed) {
             const absl::StatusOr<double> value = parse_number(name, typed, range, whole);
             if (value.ok()) set(*value);
             return value.status();
           });
}

void add_enum_value(CLI::App& app, const std::string& section, const std::string& name,
                    const std::string& what, const google::protobuf::EnumDescriptor& type, int initial,
                    const std::string& help, std::function<void(int)> set) {
  const std::string text =
      absl::StrFormat("%s: %s (default %s)", help, choice_help(type), v1::enum_word(type, initial));
  add_text(app, section, name, "NAME", text, [what, &type, set = std::move(set)](const std::string& typed) {
    const absl::StatusOr<int> value = enum_value(type, what, typed);
    if (value.ok()) set(*value);
    return value.status();
  });
}

void add_json_option(CLI::App& app, const std::string& section, const std::string& help, std::string& path) {
  add_text(app, section, "--json", "FILE|-", help + "; - is stdout", path);
}

void add_quiet_option(CLI::App& app, const std::string& section, bool& quiet) {
  app.add_flag("--quiet,-q", quiet, "Print nothing but errors")->group(section);
}

}  // namespace candela
