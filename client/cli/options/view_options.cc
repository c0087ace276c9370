#include "client/cli/options/view_options.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/options/enum_words.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/usage.h"

namespace candela {
namespace {

constexpr v1::ToneCurve kDefaultCurve = v1::TONE_CURVE_ACES_HILL;

// All but the table, which --ocio makes.
std::vector<std::string> curve_words() {
  std::vector<std::string> words = enum_words(*v1::ToneCurve_descriptor());
  std::erase(words, word_of(v1::TONE_CURVE_TABLE));
  return words;
}

absl::Status set_curve(const std::string& word, v1::Settings& settings) {
  const std::vector<std::string> words = curve_words();
  if (std::find(words.begin(), words.end(), word) == words.end()) return unknown_word("curve", word, words);
  const absl::StatusOr<int> value = enum_value(*v1::ToneCurve_descriptor(), "curve", word);
  if (!value.ok()) return value.status();
  settings.set_curve(static_cast<v1::ToneCurve>(*value));
  return absl::OkStatus();
}

}  // namespace

void add_view_options(CLI::App& app, const std::string& section, PictureOptions& options) {
  add_text(app, section, "--curve", "NAME",
           absl::StrFormat("Tone curve: %s (default %s)", absl::StrJoin(curve_words(), ", "),
                           word_of(kDefaultCurve)),
           [&options](const std::string& word) { return set_curve(word, options.settings); });
  const auto add = [&](const char* name, const char* placeholder, const char* help, std::string& to) {
    add_text(app, section, name, placeholder, help, [name, &to](const std::string& text) {
      if (text.empty())
        return usage_error(absl::StrFormat("%s is empty; leave it out for its default", name));
      to = text;
      return absl::OkStatus();
    });
  };
  add("--ocio", "CONFIG", "In place of a curve: a view of this OpenColorIO configuration",
      options.view.config);
  add("--display", "NAME", "Display of --ocio (default: the configuration's)", options.view.display);
  add("--view", "NAME", "View of --ocio (default: the display's)", options.view.view);
  add("--ocio-input", "NAME",
      "Colour space of --ocio that the scene's linear Rec.709 is taken to be in (default: found out)",
      options.view.input);
}

absl::Status finish_view_options(PictureOptions& options, const std::string& output, bool encoded) {
  const ViewChoice& view = options.view;
  if (view.config.empty()) {
    for (const auto& [name, value] : {std::pair("--display", view.display), std::pair("--view", view.view),
                                      std::pair("--ocio-input", view.input)}) {
      if (!value.empty()) {
        return usage_error(absl::StrFormat(
            "%s is part of an OpenColorIO configuration; name that with --ocio CONFIG", name));
      }
    }
    return absl::OkStatus();
  }
  if (options.settings.curve() != v1::TONE_CURVE_UNSPECIFIED) {
    return usage_error("--ocio takes the place of --curve; give one of them");
  }
  if (options.settings.transfer() != v1::TRANSFER_UNSPECIFIED) {
    options.notes.push_back("--transfer changes nothing: the view of --ocio has its own encoding");
  }
  if (!encoded) {
    options.notes.push_back(absl::StrFormat("%s holds the view's display values, not linear light", output));
  }
  options.settings.set_curve(v1::TONE_CURVE_TABLE);
  options.write.transfer = EncodedTransfer::kUnknown;
  return absl::OkStatus();
}

}  // namespace candela
