// The table of candelad's options: one row per option. Everything about an option comes from its row: the
// flag, the environment variable, the key of the configuration file, the range check, --help and
// deploy/candelad.conf.
//
// To add an option, add a field with its default to Config and a row here, and run
//   candelad --print-config >deploy/candelad.conf
#pragma once

#include <span>
#include <string>
#include <variant>
#include <vector>

#include "absl/status/status.h"
#include "proto/candela/v1/limits.h"
#include "server/config.h"

namespace candela {

// The kinds of options. Each kind names its field of Config; ranges are inclusive.
struct FlagOption {
  bool Config::*field;
};
struct TextOption {
  std::string Config::*field;
  const char* value_name;  // "FILE"
};
struct AddressListOption {
  std::vector<std::string> Config::*field;  // written with commas
};
struct NumberOption {
  uint32_t Config::*field;
  v1::Range<uint32_t> range;
};
struct BytesOption {
  uint64_t Config::*field;
  v1::Range<uint64_t> range;
  bool zero_is_automatic = false;  // 0 is allowed below the range
};
struct DurationOption {
  absl::Duration Config::*field;
  v1::Range<absl::Duration> range;
};
struct LogLevelOption {
  LogLevel Config::*field;
};
struct ExecutorOption {
  ExecutorKind Config::*field;
};

using OptionKind = std::variant<FlagOption, TextOption, AddressListOption, NumberOption, BytesOption,
                                DurationOption, LogLevelOption, ExecutorOption>;

struct Option {
  // "max-calls": the flag is --max-calls, the variable CANDELA_MAX_CALLS, the key in the file max-calls.
  const char* name;
  OptionKind kind;
  // For --help and the annotated file: one sentence, without its full stop and without the range.
  const char* help;
  // For the annotated file only: more sentences.
  const char* note = "";
};

std::span<const Option> option_table();

// The option's environment variable, such as "CANDELA_MAX_CALLS".
std::string variable_name(const Option& option);

// The environment variables of all options.
std::vector<std::string> variable_names();

// The option's range, "1 .. 4096"; empty if its kind has none.
std::string range_text(const Option& option);

// The option's value in `config` as a user writes it: "64", "512MiB", "1m", "true".
std::string value_text(const Option& option, const Config& config);

// INVALID_ARGUMENT for the first option that is out of its range: "max-calls is 0; it must be 1 .. 4096".
absl::Status check_ranges(const Config& config);

// deploy/candelad.conf: every option, explained, with its value in `config`.
std::string annotated_file(const Config& config);

}  // namespace candela
