#include "client/run/server/option_words.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "client/base/failure.h"
#include "client/base/usage.h"
#include "proto/candela/v1/settings.h"

namespace candela {
namespace {

// A field's name in a refusal, and the option that sets it.
struct Name {
  std::string field;
  std::string option;
};

// Fields of calls and sessions, which render.proto declares no options for.
constexpr std::pair<const char*, const char*> kCallFields[] = {
    {"open.session", "--session"},
    {"open.lookahead", "--lookahead"},
    {"open.cut_threshold_ev", "--detect-cuts"},
    {"open.jpeg_quality", "--quality"},
    {"open.encoding", "--encoding"},
    {"open.state", "--state"},
    {"encoding", "--encoding"},
    {"jpeg_quality", "--quality"},
    {"previous.exposure", "--previous-exposure"},
    {"previous.elapsed_seconds", "--elapsed"},
    {"frame.exposure", "the frame's exposure"},
    {"frame.media_time_ns", "the frame's media time"},
    {"output_format", "the output's format"},
    {"table", "the view's table"},
    {"view.camera.fov_deg", "--fov"},
    {"view.camera.yaw_deg", "--yaw"},
    {"view.camera.pitch_deg", "--pitch"},
    {"view.camera.roll_deg", "--roll"},
    {"view.rotation_deg", "--rotation"},
    {"view.objects", "--objects"},
    {"view.samples", "--samples"},
    {"rotation_deg", "--rotation"},
    {"roughness_mapping", "--roughness-mapping"},
};

std::vector<Name> names_for(const v1::Settings& given) {
  std::vector<Name> names;
  for (const v1::SettingField& setting : v1::setting_fields()) {
    const std::string& flag = setting.declaration().flag();
    if (!flag.empty()) names.push_back({setting.path, "--" + flag});
  }
  for (const auto& [field, option] : kCallFields) names.push_back({field, option});
  // Without the option they are the file's own.
  names.push_back({"input_chromaticities",
                   given.has_input_chromaticities() ? "--primaries" : "the file's chromaticities"});
  // The longest name that fits is the one that is meant.
  std::sort(names.begin(), names.end(),
            [](const Name& a, const Name& b) { return a.field.size() > b.field.size(); });
  return names;
}

bool in_name(char c) { return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '-'; }

// True if `text` begins with this name and means the field by it. Names such as "curve" are also words, and
// mean the field if its value follows.
bool means(absl::string_view text, const Name& name) {
  if (!absl::ConsumePrefix(&text, name.field)) return false;
  if (!text.empty() && in_name(text[0])) return false;
  if (text.size() > 1 && text[0] == '.' && in_name(text[1])) return false;
  return name.field.find_first_of("._") != std::string::npos || absl::StartsWith(text, " is ");
}

// The field that begins at `at`. Null: none.
const Name* name_at(const std::vector<Name>& names, absl::string_view text, size_t at) {
  if (at > 0 && (in_name(text[at - 1]) || text[at - 1] == '.')) return nullptr;
  const auto found = std::find_if(names.begin(), names.end(),
                                  [&](const Name& name) { return means(text.substr(at), name); });
  return found == names.end() ? nullptr : &*found;
}

}  // namespace

absl::Status in_options(const absl::Status& refusal, const v1::Settings& given) {
  const std::vector<Name> names = names_for(given);
  const absl::string_view text = refusal.message();
  std::string words;
  bool first_is_option = false;
  for (size_t at = 0; at < text.size();) {
    const Name* name = name_at(names, text, at);
    if (at == 0) first_is_option = name != nullptr && absl::StartsWith(name->option, "--");
    absl::StrAppend(&words, name == nullptr ? text.substr(at, 1) : absl::string_view(name->option));
    at += name == nullptr ? 1 : name->field.size();
  }
  if (absl::IsInvalidArgument(refusal) && first_is_option) return usage_error(words);
  return of_server(reworded(refusal, words));
}

absl::Status of_server(const absl::Status& status) {
  const bool about_frame = absl::IsInvalidArgument(status) || absl::IsResourceExhausted(status);
  return failure_of(about_frame ? FailureKind::kInput : FailureKind::kServer, status);
}

}  // namespace candela
