// The kinds of options, and the words that they take.
#pragma once

#include <google/protobuf/descriptor.h>
#include <google/protobuf/generated_enum_reflection.h>

#include <CLI/App.hpp>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "proto/candela/v1/limits.h"

namespace candela {

// The words for the values of an enum on the command line: its own, and the other names by which people know
// them. Case, spaces, dots, hyphens and underscores do not matter: "Rec.709" is rec709.

// The enum's own words that a user may give, in the order of the contract.
std::vector<std::string> choice_words(const google::protobuf::EnumDescriptor& type);

// The same for --help, with other names: "rec709 (srgb, linear-srgb, bt709), rec2020 (bt2020)".
std::string choice_help(const google::protobuf::EnumDescriptor& type);
// The same of some of the enum's words.
std::string choice_help(const google::protobuf::EnumDescriptor& type, std::vector<std::string> words);

// The value that a word means. The usage error suggests near words, or what to do instead. `what` is, for
// example, "curve".
absl::StatusOr<int> enum_value(const google::protobuf::EnumDescriptor& type, const std::string& what,
                               const std::string& word);

// Helpers that define the command's options. Each option shows its range and default in --help, and refuses a
// value with a usage error that names the option, the value and the allowed values.

// Carries a usage error out of CLI11's parser.
struct OptionError {
  absl::Status status;
};

// Adds an option to a section of the help. `set` accepts or refuses its text, which is not empty: a script
// that gives "" lacks a value, and must not turn the option off silently. An empty variable of the
// environment counts as none. If the option is given twice, the last one counts.
CLI::Option* add_text(CLI::App& app, const std::string& section, const std::string& name,
                      const std::string& placeholder, const std::string& help,
                      std::function<absl::Status(const std::string&)> set);

// The same for text that is stored unchanged.
CLI::Option* add_text(CLI::App& app, const std::string& section, const std::string& name,
                      const std::string& placeholder, const std::string& help, std::string& text);

// Adds an option for a number in a range; `whole` refuses fractions.
void add_number(CLI::App& app, const std::string& section, const std::string& name, const std::string& unit,
                v1::Range<double> range, double initial, const std::string& help,
                std::function<void(double)> set, bool whole = false);

// Adds an option for a word of an enum.
template <typename Enum>
void add_enum(CLI::App& app, const std::string& section, const std::string& name, const std::string& what,
              Enum initial, const std::string& help, std::function<void(Enum)> set);

// --json FILE|-
void add_json_option(CLI::App& app, const std::string& section, const std::string& help, std::string& path);

// --quiet
void add_quiet_option(CLI::App& app, const std::string& section, bool& quiet);

// Parses the text of the option `name` as a number in the range. Fails with a usage error.
absl::StatusOr<double> parse_number(const std::string& name, const std::string& text, v1::Range<double> range,
                                    bool whole = false);

// Parses the text of the option `name` as so many numbers in the range, separated by commas. Fails with a
// usage error.
absl::StatusOr<std::vector<double>> parse_list(const std::string& name, const std::string& text, size_t count,
                                               v1::Range<double> range, bool whole = false);

// Parses "on" or "off" for the option `name`. Fails with a usage error.
absl::StatusOr<bool> parse_switch(const std::string& name, const std::string& text);

std::string format_range(v1::Range<double> range);  // "0 .. 10"

// ---- Only the template's body follows ----

void add_enum_value(CLI::App& app, const std::string& section, const std::string& name,
                    const std::string& what, const google::protobuf::EnumDescriptor& type, int initial,
                    const std::string& help, std::function<void(int)> set);

template <typename Enum>
void add_enum(CLI::App& app, const std::string& section, const std::string& name, const std::string& what,
              Enum initial, const std::string& help, std::function<void(Enum)> set) {
  add_enum_value(app, section, name, what, *google::protobuf::GetEnumDescriptor<Enum>(), initial, help,
                 [set](int value) { set(static_cast<Enum>(value)); });
}

}  // namespace candela
