#include "client/cli/options/option_kinds.h"

#include <cmath>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/options/enum_words.h"
#include "client/cli/options/usage.h"

namespace candela {

CLI::Option* add_text(CLI::App& app, const std::string& section, const std::string& name,
                      const std::string& placeholder, const std::string& help,
                      std::function<absl::Status(const std::string&)> set) {
  const auto take = [set = std::move(set)](const std::string& text) {
    if (absl::Status status = set(text); !status.ok()) throw OptionError{std::move(status)};
  };
  return app.add_option_function<std::string>(name, take, help)
      ->option_text(placeholder)
      ->group(section)
      ->take_last();
}

std::string format_number(double value) {
  int exponent = 0;
  if (std::frexp(value, &exponent) == 0.5 && std::abs(exponent - 1) >= 20) {
    return absl::StrFormat("2^%d", exponent - 1);
  }
  return absl::StrFormat("%.7g", value);
}

std::string format_range(v1::Range<double> range) {
  return absl::StrFormat("%s .. %s", format_number(range.min), format_number(range.max));
}

absl::StatusOr<double> parse_number(const std::string& name, const std::string& text, v1::Range<double> range,
                                    bool whole) {
  double value = 0;
  if (!absl::SimpleAtod(text, &value) || std::isnan(value)) {
    return usage_error(absl::StrFormat("%s is \"%s\", which is not a number; it must be %s", name, text,
                                       format_range(range)));
  }
  if (value < range.min || value > range.max || (whole && value != std::floor(value))) {
    return usage_error(absl::StrFormat("%s is %s; it must be %s%s", name, text,
                                       whole ? "a whole number, " : "", format_range(range)));
  }
  return value;
}

void add_number(CLI::App& app, const std::string& section, const std::string& name, const std::string& unit,
                v1::Range<double> range, double initial, const std::string& help,
                std::function<void(double)> set, bool whole) {
  const std::string text =
      absl::StrFormat("%s; %s (default %s)", help, format_range(range), format_number(initial));
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
  const std::string text = absl::StrFormat("%s: %s (default %s)", help, absl::StrJoin(enum_words(type), ", "),
                                           enum_word(type, initial));
  add_text(app, section, name, "NAME", text, [what, &type, set = std::move(set)](const std::string& typed) {
    const absl::StatusOr<int> value = enum_value(type, what, typed);
    if (value.ok()) set(*value);
    return value.status();
  });
}

}  // namespace candela
