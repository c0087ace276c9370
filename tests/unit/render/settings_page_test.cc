// docs/settings.md, made from the declarations in render.proto.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "proto/candela/v1/settings.h"
#include "tests/support/files.h"

namespace candela::v1 {
namespace {

constexpr char kUpdate[] = "CANDELA_UPDATE_PAGES=1 ctest --test-dir BUILD_FOLDER -R SettingsPage";

constexpr char kOpening[] =
    R"(# Settings

A setting says how Candela renders a frame. This page lists every setting with the option of `candela` that sets it, its range
and its default. A client sets the same settings in the message `candela.v1.Settings`; the names below are the fields' names
there. A client that builds its own controls gets this list from the rpc `GetServerInfo`. `candela info --json -` prints it.

An absent setting takes its default. The server refuses a value outside of its range with INVALID_ARGUMENT and never clamps
it. Ranges are inclusive. "none" means that the setting has no default and stays absent.

[pipeline.md](pipeline.md) defines what each setting does to the image. This page is generated from
[render.proto](../proto/candela/v1/render.proto). Do not edit it. Change the option `(setting)` at the field, then run

    %s
)";

constexpr char kClosing[] =
    R"(
## Settings without an option, and options without a setting

`candela` chooses `output_format` by the type of the output file. Without `--alpha` it asks for `straight` for a .png or .avif, and for
`ignore` if a file's alpha is 0 everywhere although there is light. It sends the primaries that the image's file names, unless
`--primaries` is given; a message without primaries means `rec709`. Two fields of the message are not in the tables above
because each is a message of several numbers. `render.proto` describes them.

| field | option | what it does |
|---|---|---|
| `input_chromaticities` | `--primaries` with eight numbers | the image's primaries and white as CIE xy |
| `table` | `--ocio`, `--display`, `--ocio-view`, `--ocio-input`, `--lut`, `--lut-input` | a colour table in place of a curve; `candela` makes it from an OpenColorIO view or a LUT and sets `curve` to `table` |
)";

std::string code(const std::string& text) { return absl::StrCat("`", text, "`"); }

// A number with its unit: "0.18 luminance".
std::string with_unit(const std::string& number, const Setting& declaration) {
  return declaration.unit().empty() ? number : absl::StrCat(number, " ", declaration.unit());
}

std::string range_text(const SettingField& setting) {
  const Setting& declaration = setting.declaration();
  if (!setting.is_number()) return "";
  std::string text = with_unit(format_range(declaration.min(), declaration.max()), declaration);
  for (const Setting::Exception& exception : declaration.except()) {
    if (!exception.has_min() && !exception.has_max()) continue;
    absl::StrAppendFormat(&text, "; with `%s` %s", exception.word(), format_range(declaration, exception));
  }
  return text;
}

std::string default_text(const SettingField& setting) {
  const Setting& declaration = setting.declaration();
  if (setting.field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_BOOL) {
    return declaration.default_() != 0 ? "on" : "off";
  }
  std::string text = !declaration.default_word().empty() ? code(declaration.default_word())
                     : declaration.has_default_()        ? format_number(declaration.default_())
                                                         : "none";
  for (const Setting::Exception& exception : declaration.except()) {
    if (!exception.has_default_() && exception.default_word().empty()) continue;
    absl::StrAppendFormat(
        &text, "; with `%s` %s", exception.word(),
        exception.has_default_() ? format_number(exception.default_()) : code(exception.default_word()));
  }
  return text;
}

std::string row(const SettingField& setting) {
  const SettingInfo info = setting_info(setting);
  const Setting& declaration = setting.declaration();
  const std::vector<std::string> cells = {
      code(setting.path),
      declaration.flag().empty() ? "" : code("--" + declaration.flag()),
      absl::StrReplaceAll(word_of(info.kind()), {{"-", " "}}),
      range_text(setting),
      default_text(setting),
      absl::StrReplaceAll(declaration.help(), {{"|", "\\|"}}),
  };
  return absl::StrCat("| ", absl::StrJoin(cells, " | "), " |\n");
}

// The choices of a setting, one a line; "" if it is no choice.
std::string choices(const SettingField& setting) {
  const SettingInfo info = setting_info(setting);
  if (info.choices().empty()) return "";
  std::string text = absl::StrCat("\n", code(setting.path), " is one of:\n\n");
  for (const SettingInfo::Choice& choice : info.choices()) {
    absl::StrAppend(&text, "- ", code(choice.word()), choice.summary().empty() ? "" : ": ", choice.summary(),
                    "\n");
  }
  return text;
}

std::string page() {
  std::vector<std::string> groups;  // in the order of the contract
  for (const SettingField& setting : setting_fields()) {
    const std::string& group = setting.declaration().group();
    if (std::find(groups.begin(), groups.end(), group) == groups.end()) groups.push_back(group);
  }
  std::string text = absl::StrFormat(kOpening, kUpdate);
  for (const std::string& group : groups) {
    absl::StrAppend(&text, "\n## ", group,
                    "\n\n| setting | option | kind | range | default | what it does |\n",
                    "|---|---|---|---|---|---|\n");
    std::string lists;
    for (const SettingField& setting : setting_fields()) {
      if (setting.declaration().group() != group) continue;
      absl::StrAppend(&text, row(setting));
      absl::StrAppend(&lists, choices(setting));
    }
    absl::StrAppend(&text, lists);
  }
  return absl::StrCat(text, kClosing);
}

TEST(SettingsPage, IsWhatTheContractDeclares) {
  if (std::getenv("CANDELA_UPDATE_PAGES") != nullptr) write_file(CANDELA_SETTINGS_PAGE, page());
  EXPECT_EQ(read_file(CANDELA_SETTINGS_PAGE), page()) << "docs/settings.md is not current; run: " << kUpdate;
}

}  // namespace
}  // namespace candela::v1
