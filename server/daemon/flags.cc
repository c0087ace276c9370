#include "server/daemon/flags.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <functional>
#include <istream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "server/base/address.h"
#include "server/base/option_file.h"
#include "server/base/words.h"
#include "server/config.h"

namespace candela {
namespace {

// candelad's configuration file. CLI11 reads its TOML a line at a time, so that every error can name its
// line.

// Thrown for a line that cannot be used.
struct ConfigLineError {
  int line = 0;      // from 1
  std::string what;  // names the key
};

class ConfigFile final : public CLI::ConfigTOML {
 public:
  // `check` says whether an option takes a value.
  using Check = std::function<absl::Status(const Option& option, const std::string& value)>;
  explicit ConfigFile(Check check) : check_(std::move(check)) {}

  // Throws a ConfigLineError for an unknown key, one that is given twice, a value that its option refuses,
  // and a section.
  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override;

 private:
  const Check check_;
};

const Option& option_named(const std::string& key, int line) {
  std::vector<std::string> names;
  for (const Option& option : option_table()) {
    if (key == option.name) return option;
    names.emplace_back(option.name);
  }
  const std::string meant = did_you_mean(near_words(key, names));
  throw ConfigLineError{line, absl::StrFormat("unknown key \"%s\"; %ssee candelad --print-config", key,
                                              meant.empty() ? "" : meant + " ")};
}

std::vector<CLI::ConfigItem> ConfigFile::from_config(std::istream& input) const {
  std::vector<CLI::ConfigItem> read;
  std::map<std::string, int> lines;  // of the keys
  std::string text;
  for (int line = 1; std::getline(input, text); ++line) {
    if (absl::StartsWith(absl::StripLeadingAsciiWhitespace(text), "[")) {
      throw ConfigLineError{
          line, absl::StrCat("the section ", text, " is not known; write lines KEY = VALUE alone")};
    }
    std::istringstream one(text);
    for (CLI::ConfigItem& item : CLI::ConfigTOML::from_config(one)) {
      const std::string key = item.fullname();
      const Option& option = option_named(key, line);
      const auto [first, fresh] = lines.emplace(key, line);
      if (!fresh) {
        throw ConfigLineError{
            line, absl::StrFormat("%s is given in line %d, too; remove one of them", key, first->second)};
      }
      if (item.inputs.size() > 1 && !std::holds_alternative<AddressListOption>(option.kind)) {
        throw ConfigLineError{
            line, absl::StrFormat("%s has %d values; write one, in quotes", key, item.inputs.size())};
      }
      item.inputs = {absl::StrJoin(item.inputs, ",")};
      if (absl::Status status = check_(option, item.inputs.front()); !status.ok()) {
        throw ConfigLineError{line, std::string(status.message())};
      }
      read.push_back(std::move(item));
    }
  }
  return read;
}

}  // namespace
}  // namespace candela

#ifndef CANDELA_VERSION
#error "the build sets CANDELA_VERSION"
#endif

namespace candela {
namespace {

constexpr size_t kMaxConfigBytes = 1 << 20;

// Thrown for a configuration file that cannot be read.
struct ConfigFileError {
  std::string what;
};

// Puts a parsed value into its field, or gives the reason why there is none.
template <typename Value>
absl::Status store(absl::StatusOr<Value> parsed, Value& field) {
  if (parsed.ok()) field = *std::move(parsed);
  return parsed.status();
}

// set() reads a value of each kind.
absl::Status set(const TextOption& kind, const std::string& text, Config& config) {
  config.*kind.field = text;
  return absl::OkStatus();
}

absl::Status set(const AddressListOption& kind, const std::string& text, Config& config) {
  config.*kind.field = absl::StrSplit(text, ',', absl::SkipWhitespace());
  if (!(config.*kind.field).empty()) return absl::OkStatus();
  return absl::InvalidArgumentError("it names no address; write 127.0.0.1:50051 or unix:PATH");
}

absl::Status set(const BytesOption& kind, const std::string& text, Config& config) {
  return store(parse_bytes(text), config.*kind.field);
}

absl::Status set(const DurationOption& kind, const std::string& text, Config& config) {
  return store(parse_duration(text), config.*kind.field);
}

absl::Status set(const LogLevelOption& kind, const std::string& text, Config& config) {
  return store(parse_log_level(text), config.*kind.field);
}

absl::Status set(const ExecutorOption& kind, const std::string& text, Config& config) {
  return store(parse_executor(text), config.*kind.field);
}

// CLI11 reads these by itself in flags and variables.
absl::Status set(const FlagOption& kind, const std::string& text, Config& config) {
  if (CLI::detail::lexical_cast(text, config.*kind.field)) return absl::OkStatus();
  return absl::InvalidArgumentError("it must be true or false");
}

absl::Status set(const NumberOption& kind, const std::string& text, Config& config) {
  if (CLI::detail::lexical_cast(text, config.*kind.field)) return absl::OkStatus();
  return absl::InvalidArgumentError("it must be a whole number");
}

std::string value_name(const TextOption& kind) { return kind.value_name; }
std::string value_name(const AddressListOption&) { return "ADDRESS[,ADDRESS...]"; }
std::string value_name(const BytesOption&) { return "BYTES"; }
std::string value_name(const DurationOption&) { return "TIME"; }
std::string value_name(const LogLevelOption&) { return "LEVEL"; }
std::string value_name(const ExecutorOption&) { return "WHO"; }

CLI::Option* add(CLI::App& app, const std::string& flag, const FlagOption& kind, Config& config) {
  return app.add_flag(flag, config.*kind.field);
}

CLI::Option* add(CLI::App& app, const std::string& flag, const NumberOption& kind, Config& config) {
  return app.add_option(flag, config.*kind.field)->type_name("NUMBER");
}

template <typename Kind>
CLI::Option* add(CLI::App& app, const std::string& flag, const Kind& kind, Config& config) {
  const auto apply = [flag, kind, &config](const std::string& text) {
    const absl::Status status = set(kind, text, config);
    if (!status.ok()) throw CLI::ValidationError(flag, std::string(status.message()));
  };
  return app.add_option_function<std::string>(flag, apply)->type_name(value_name(kind));
}

// The values in `config` are the defaults. A flag that is given twice takes the last value.
void add_options(CLI::App& app, Config& config) {
  for (const Option& option : option_table()) {
    const std::string flag = absl::StrCat("--", option.name);
    CLI::Option* added =
        std::visit([&](const auto& kind) { return add(app, flag, kind, config); }, option.kind);
    const std::string range = range_text(option);
    added->description(range.empty() ? option.help : absl::StrCat(option.help, " (", range, ")"))
        ->envname(variable_name(option))
        ->take_last();
    if (!std::holds_alternative<FlagOption>(option.kind)) added->default_str(value_text(option, config));
  }
}

// Whether the option takes this value of the configuration file.
absl::Status check_value(const Option& option, const std::string& value) {
  Config config;
  const absl::Status status =
      std::visit([&](const auto& kind) { return set(kind, value, config); }, option.kind);
  if (!status.ok()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s is \"%s\": %s", option.name, value, status.message()));
  }
  return check_ranges(config);
}

// Without this, CLI11 would let the file override the environment. Fails for a variable whose value its
// option refuses.
absl::Status apply_environment(CLI::App& app) {
  for (const Option& option : option_table()) {
    const std::string name = variable_name(option);
    const char* value = std::getenv(name.c_str());
    if (value == nullptr || *value == '\0') continue;
    if (absl::Status status = check_value(option, value); !status.ok()) {
      return absl::InvalidArgumentError(absl::StrCat(name, ": ", status.message()));
    }
    app.get_option(absl::StrCat("--", option.name))->add_result(value);
  }
  return absl::OkStatus();
}

// Suggests an option for a word that CLI11 does not know.
std::string unknown_argument(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) names.push_back(option->get_name());
  const std::string word = app.remaining().empty() ? "" : app.remaining().front();
  const std::string meant = did_you_mean(near_words(word, names));
  return absl::StrFormat("unknown argument \"%s\"; %ssee candelad --help", word,
                         meant.empty() ? "" : meant + " ");
}

// Refuses a file that CLI11 could read for ever, such as a pipe or a device.
std::string check_file(const std::string& path) {
  const absl::StatusOr<std::string> text =
      read_option_file("--config", path, kMaxConfigBytes, Secrecy::kPublic);
  if (!text.ok()) throw ConfigFileError{std::string(text.status().message())};
  return "";
}

void define(CLI::App& app, Invocation& invocation, bool& print_config) {
  app.footer(
      "Each option is also an environment variable (CANDELA_MEMORY_BUDGET for --memory-budget) and a key of\n"
      "the --config file (memory-budget). Flags override variables, and variables override the file.");
  app.allow_config_extras(CLI::config_extras_mode::error);
  app.config_formatter(std::make_shared<ConfigFile>(check_value));
  add_options(app, invocation.config);
  app.set_config("--config", "", "Configuration file with lines KEY = VALUE; see --print-config")
      ->type_name("FILE")
      ->check(CLI::Validator(check_file, ""));
  app.add_flag("--print-config", print_config,
               "Print a configuration file that explains every option, and exit")
      ->configurable(false);
  app.add_flag("--list-devices", invocation.list_devices, "List the Vulkan devices and exit")
      ->configurable(false);
  app.set_version_flag("--version", "candelad " CANDELA_VERSION, "Print the version and exit");
}

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

}  // namespace

absl::StatusOr<Invocation> parse_invocation(int argc, const char* const* argv) {
  Invocation invocation;
  invocation.config.listen = {kDefaultAddress};
  const Config defaults = invocation.config;
  bool print_config = false;
  CLI::App app("candelad: a gRPC server that renders HDR frames.\n", "candelad");
  define(app, invocation, print_config);
  absl::Status environment;
  app.preparse_callback([&](size_t) { environment = apply_environment(app); });
  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp&) {
    invocation.text = app.help();
    return invocation;
  } catch (const CLI::CallForVersion& version) {
    invocation.text = absl::StrFormat("%s\n", version.what());
    return invocation;
  } catch (const ConfigFileError& error) {
    return absl::InvalidArgumentError(error.what + "; name a file such as deploy/candelad.conf");
  } catch (const ConfigLineError& error) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s:%d: %s", app.get_config_ptr()->as<std::string>(), error.line, error.what));
  } catch (const CLI::ExtrasError&) {
    return absl::InvalidArgumentError(unknown_argument(app));
  } catch (const CLI::Error& error) {
    if (!environment.ok()) return environment;
    return absl::InvalidArgumentError(first_line(error.what()) + "; see candelad --help");
  }
  environment.Update(check_config(invocation.config));
  if (!environment.ok()) return environment;
  if (print_config) invocation.text = annotated_file(defaults);
  return invocation;
}

}  // namespace candela
