// The kinds of options there are. Each shows its range and default in --help, and refuses a value with a
// usage error that names the option, the value and what it may be.
#pragma once

#include <google/protobuf/generated_enum_reflection.h>

#include <CLI/App.hpp>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "proto/candela/v1/limits.h"

namespace candela {

// How a usage error leaves CLI11's parser.
struct OptionError {
  absl::Status status;
};

// An option of one section of the help whose text `set` takes or refuses. Given twice, the last one counts.
CLI::Option* add_text(CLI::App& app, const std::string& section, const std::string& name,
                      const std::string& placeholder, const std::string& help,
                      std::function<absl::Status(const std::string&)> set);

// A number in a range; `whole` for those that have no fraction.
void add_number(CLI::App& app, const std::string& section, const std::string& name, const std::string& unit,
                v1::Range<double> range, double initial, const std::string& help,
                std::function<void(double)> set, bool whole = false);

// One of an enum's words.
template <typename Enum>
void add_enum(CLI::App& app, const std::string& section, const std::string& name, const std::string& what,
              Enum initial, const std::string& help, std::function<void(Enum)> set);

// A number in a range from the text of the option `name`, or a usage error.
absl::StatusOr<double> parse_number(const std::string& name, const std::string& text, v1::Range<double> range,
                                    bool whole = false);

// As people write it: "64", "0.18", "2^40".
std::string format_number(double value);
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
