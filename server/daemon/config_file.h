// candelad's configuration file. CLI11 reads its TOML a line at a time, so that every error can name its
// line.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <istream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "server/option_table.h"

namespace candela {

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

}  // namespace candela
