#include "client/cli/commands/config_info.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/files/failure_line.h"
#include "client/cli/files/json_output.h"

namespace candela {

std::string to_text(const std::string& path, const ConfigViews& config) {
  std::string text = absl::StrFormat("%s: OpenColorIO configuration, version %s, %d colour spaces\n", path,
                                     config.version, config.color_spaces.size());
  for (const ConfigViews::Display& display : config.displays) {
    absl::StrAppend(&text, "  display \"", display.name, "\"",
                    display.name == config.default_display ? " (default)" : "", "\n");
    for (const std::string& view : display.views) {
      absl::StrAppend(&text, "    view \"", view, "\"", view == display.default_view ? " (default)" : "",
                      "\n");
    }
  }
  return text;
}

std::string to_json(const std::string& path, const ConfigViews& config) {
  nlohmann::ordered_json displays = nlohmann::ordered_json::array();
  for (const ConfigViews::Display& display : config.displays) {
    displays.push_back(
        {{"name", display.name}, {"default_view", display.default_view}, {"views", display.views}});
  }
  return line_of(nlohmann::ordered_json{{"config", path},
                                        {"version", config.version},
                                        {"default_display", config.default_display},
                                        {"displays", displays},
                                        {"color_spaces", config.color_spaces}});
}

}  // namespace candela
