#include "client/color/view_config.h"

#include <filesystem>
#include <system_error>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/color/lut_config.h"

namespace candela {
namespace {

namespace ocio = OCIO_NAMESPACE;

constexpr char kBuiltIn[] = "ocio://";  // begins the names of OpenColorIO's own configurations
constexpr int kFirstWithBuiltIn = 0x02020000;

std::string one_line(const char* text) {
  return absl::StrJoin(absl::StrSplit(text, absl::ByAnyChar("\n\r\t"), absl::SkipWhitespace()), " ");
}

const char* kind_of(const ViewChoice& choice) {
  return choice.lut_input.empty() ? "an OpenColorIO configuration" : "a LUT, such as look.cube";
}

// The part of `text` between `before` and `after`; empty if either is missing.
std::string between(const std::string& text, const std::string& before, const std::string& after) {
  const size_t begin = text.find(before);
  if (begin == std::string::npos) return "";
  const size_t from = begin + before.size();
  return text.substr(from, text.find(after, from) - from);
}

absl::Status too_new(const ViewChoice& choice, const std::string& reason) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: OpenColorIO %s, which is installed here, is too old for it: %s; --curve aces-2 "
                      "shows ACES 2.0, and "
                      "a newer OpenColorIO can bake any view, as a LUT (ociobakelut) for --lut or by "
                      "bake_view() of Candela's "
                      "Python package",
                      choice.config, ocio::GetVersion(), reason));
}

}  // namespace

absl::Status unusable(const ViewChoice& choice, const std::exception& thrown) {
  const std::string reason = one_line(thrown.what());
  if (absl::StrContains(reason, "is not able to load that config version")) {
    return too_new(choice, absl::StrCat("it is of version ", between(reason, "is version ", ". ")));
  }
  if (const std::string style = between(reason, "invalid built-in transform style '", "'"); !style.empty()) {
    return too_new(choice, absl::StrFormat("it has the built-in transform \"%s\"", style));
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: OpenColorIO cannot use it: %s", choice.config, reason));
}

absl::StatusOr<ocio::ConstConfigRcPtr> load_config(const ViewChoice& choice) {
  const bool built_in = absl::StartsWith(choice.config, kBuiltIn);
  if (built_in && ocio::GetVersionHex() < kFirstWithBuiltIn) {
    return too_new(choice, "it has no built-in configurations");
  }
  std::error_code failed;
  if (!built_in && !std::filesystem::exists(choice.config, failed)) {
    return absl::NotFoundError(absl::StrFormat("%s: no such file; %s takes %s", choice.config,
                                               choice.lut_input.empty() ? "--ocio" : "--lut",
                                               kind_of(choice)));
  }
  // OpenColorIO would wait for a pipe's writer.
  if (!built_in && !std::filesystem::is_regular_file(choice.config, failed)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: not a regular file; name %s", choice.config, kind_of(choice)));
  }
  ocio::SetLoggingLevel(ocio::LOGGING_LEVEL_NONE);
  try {
    return choice.lut_input.empty() ? ocio::Config::CreateFromFile(choice.config.c_str())
                                    : lut_config(choice);
  } catch (const std::exception& thrown) {
    return unusable(choice, thrown);
  }
}

absl::StatusOr<ConfigViews> views_of(const ViewChoice& choice) {
  const absl::StatusOr<ocio::ConstConfigRcPtr> loaded = load_config(choice);
  if (!loaded.ok()) return loaded.status();
  const ocio::Config& config = **loaded;
  ConfigViews found;
  found.version = absl::StrFormat("%d.%d", config.getMajorVersion(), config.getMinorVersion());
  found.default_display = config.getDefaultDisplay();
  for (int i = 0; i < config.getNumDisplays(); ++i) {
    ConfigViews::Display& display = found.displays.emplace_back();
    display.name = config.getDisplay(i);
    display.default_view = config.getDefaultView(display.name.c_str());
    for (int k = 0; k < config.getNumViews(display.name.c_str()); ++k) {
      display.views.emplace_back(config.getView(display.name.c_str(), k));
    }
  }
  for (int i = 0; i < config.getNumColorSpaces(); ++i) {
    found.color_spaces.emplace_back(config.getColorSpaceNameByIndex(i));
  }
  return found;
}

}  // namespace candela
