#include "client/color/view_config.h"

#include <OpenColorIO/OpenColorIO.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <span>
#include <system_error>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "client/color/view_table.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/render/color/primaries.h"

namespace candela {
namespace {

namespace ocio = OCIO_NAMESPACE;

// The names and aliases that configurations use for linear Rec.709.
constexpr const char* kRec709Names[] = {
    "lin_rec709_scene",           "lin_rec709_srgb", "lin_rec709",    "lin_srgb",
    "Linear Rec.709 (sRGB)",      "Linear Rec.709",  "Linear BT.709", "Utility - Linear - sRGB",
    "Utility - Linear - Rec.709", "Linear sRGB",     "lnf_srgb"};
constexpr const char* kAp0Names[] = {"lin_ap0_scene", "ACES2065-1", "ACES - ACES2065-1", "aces", "lin_ap0"};
constexpr const char* kAp1Names[] = {"lin_ap1_scene", "ACEScg", "ACES - ACEScg", "acescg", "lin_ap1"};

ViewEntry entry_of(const std::string& space) { return {ocio::GroupTransform::Create(), space, {}}; }

ViewEntry ap1_entry(const std::string& space) {
  ViewEntry entry = entry_of(space);
  append_builtin(entry.from_rec709, "UTILITY - ACES-AP1_to_LINEAR-REC709_BFD", ocio::TRANSFORM_DIR_INVERSE);
  return entry;
}

ViewEntry ap0_entry(const std::string& space) {
  ViewEntry entry = ap1_entry(space);
  append_builtin(entry.from_rec709, "ACEScg_to_ACES2065-1", ocio::TRANSFORM_DIR_FORWARD);
  return entry;
}

// The name of the first of the colour spaces that the configuration has, "" for none.
std::string first_space(const ocio::ConstConfigRcPtr& config, std::span<const char* const> names) {
  for (const char* name : names) {
    if (const ocio::ConstColorSpaceRcPtr space = config->getColorSpace(name)) return space->getName();
  }
  return "";
}

// The name of the colour space of a role. OpenColorIO loads a configuration whose role names none.
absl::StatusOr<std::string> space_of_role(const ocio::ConstConfigRcPtr& config, const ViewChoice& choice,
                                          const char* role) {
  const ocio::ConstColorSpaceRcPtr space = config->getColorSpace(role);
  if (space) return std::string(space->getName());
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: its role %s names a colour space that it does not have", choice.config, role));
}

std::string spaces_of(const ocio::ConstConfigRcPtr& config) {
  std::vector<std::string> names;
  for (int i = 0; i < config->getNumColorSpaces(); ++i)
    names.emplace_back(config->getColorSpaceNameByIndex(i));
  return names.empty() ? "none" : absl::StrJoin(names, ", ");
}

// For values in choice.input.
absl::StatusOr<ViewEntry> entry_for_input(const ocio::ConstConfigRcPtr& config, const ViewChoice& choice) {
  if (!config->getColorSpace(choice.input.c_str())) {
    return absl::NotFoundError(absl::StrFormat("%s has no colour space \"%s\"; there are: %s", choice.config,
                                               choice.input, spaces_of(config)));
  }
  const char* const interchange[] = {ocio::ROLE_INTERCHANGE_SCENE};
  const char* const linear[] = {ocio::ROLE_SCENE_LINEAR, choice.input.c_str()};
  if (const std::string space = first_space(config, interchange); !space.empty()) return ap0_entry(space);
  if (const std::string space = first_space(config, kRec709Names); !space.empty()) return entry_of(space);
  if (const std::string space = first_space(config, kAp0Names); !space.empty()) return ap0_entry(space);
  if (const std::string space = first_space(config, kAp1Names); !space.empty()) return ap1_entry(space);
  return entry_of(first_space(config, linear));
}

}  // namespace

void append_builtin(const ocio::GroupTransformRcPtr& group, const char* style,
                    ocio::TransformDirection direction) {
  const ocio::BuiltinTransformRcPtr builtin = ocio::BuiltinTransform::Create();
  builtin->setStyle(style);
  builtin->setDirection(direction);
  group->appendTransform(builtin);
}

absl::StatusOr<ViewEntry> find_entry(const ocio::ConstConfigRcPtr& config, const ViewChoice& choice) {
  if (!choice.input.empty()) return entry_for_input(config, choice);
  if (config->hasRole(ocio::ROLE_INTERCHANGE_SCENE)) {
    ASSIGN_OR_RETURN(const std::string space, space_of_role(config, choice, ocio::ROLE_INTERCHANGE_SCENE));
    return ap0_entry(space);
  }
  if (const std::string space = first_space(config, kRec709Names); !space.empty()) {
    ViewEntry entry = entry_of(space);
    entry.notes.push_back(absl::StrFormat(
        "the view gets the scene as \"%s\", taken to be linear Rec.709; --ocio-input names another", space));
    return entry;
  }
  if (config->hasRole(ocio::ROLE_SCENE_LINEAR)) {
    const absl::StatusOr<std::string> space = space_of_role(config, choice, ocio::ROLE_SCENE_LINEAR);
    if (!space.ok()) return space.status();
    ViewEntry entry = entry_of(*space);
    entry.notes.push_back(absl::StrFormat(
        "%s does not say what primaries its scene_linear, \"%s\", has: taken to be linear Rec.709; "
        "--ocio-input names another colour space",
        choice.config, *space));
    return entry;
  }
  return absl::NotFoundError(
      absl::StrFormat("%s has neither a role aces_interchange nor scene_linear; name its linear Rec.709 with "
                      "--ocio-input: %s",
                      choice.config, spaces_of(config)));
}

namespace {

// A look-up table's file as an OpenColorIO configuration.

struct Input {
  const char* word;
  const char* builtin;  // to ACES2065-1; null for those that are made here
};

constexpr Input kInputs[] = {{"linear", nullptr},  // of Rec.709
                             {"aces2065-1", "IDENTITY"},
                             {"acescg", "ACEScg_to_ACES2065-1"},
                             {"acescc", "ACEScc_to_ACES2065-1"},
                             {"acescct", "ACEScct_to_ACES2065-1"},
                             {"logc3", "ARRI_ALEXA-LOGC-EI800-AWG_to_ACES2065-1"},
                             {"logc4", nullptr},
                             {"slog3", "SONY_SLOG3-SGAMUT3_to_ACES2065-1"},
                             {"slog3-cine", "SONY_SLOG3-SGAMUT3.CINE_to_ACES2065-1"},
                             {"vlog", "PANASONIC_VLOG-VGAMUT_to_ACES2065-1"},
                             {"log3g10", "RED_LOG3G10-RWG_to_ACES2065-1"},
                             {"clog2", "CANON_CLOG2-CGAMUT_to_ACES2065-1"},
                             {"clog3", "CANON_CLOG3-CGAMUT_to_ACES2065-1"},
                             {"log2", nullptr}};  // of linear Rec.709

// ARRI, "LogC4 Logarithmic Color Space Specification", 2022: from linear Rec.709.
void append_logc4(const ocio::GroupTransformRcPtr& group) {
  constexpr Chromaticities kWideGamut4{{0.7347, 0.2653, 0.1424, 0.8576, 0.0991, -0.0308, 0.3127, 0.3290}};
  const std::array<float, 9> to_rec709 = **matrix_to_rec709(kWideGamut4);
  std::array<double, 16> matrix{};
  for (size_t i = 0; i < 9; ++i) matrix[i / 3 * 4 + i % 3] = to_rec709[i];
  matrix[15] = 1.0;
  const ocio::MatrixTransformRcPtr gamut = ocio::MatrixTransform::Create();
  gamut->setMatrix(matrix.data());
  gamut->setDirection(ocio::TRANSFORM_DIR_INVERSE);
  group->appendTransform(gamut);

  const double a = (std::exp2(18.0) - 16.0) / 117.45, b = (1023.0 - 95.0) / 1023.0, c = 95.0 / 1023.0;
  const double t = (std::exp2(14.0 * (-c / b) + 6.0) - 64.0) / a;
  struct Same {
    explicit Same(double v) : rgb{v, v, v} {}
    double rgb[3];
  };
  const ocio::LogCameraTransformRcPtr log = ocio::LogCameraTransform::Create(Same(t).rgb);
  log->setBase(2.0);
  log->setLogSideSlopeValue(Same(b / 14.0).rgb);
  log->setLogSideOffsetValue(Same(c - 6.0 * b / 14.0).rgb);
  log->setLinSideSlopeValue(Same(a).rgb);
  log->setLinSideOffsetValue(Same(64.0).rgb);
  group->appendTransform(log);
}

// ACES2065-1 to the input of the LUT.
ocio::GroupTransformRcPtr to_input(const std::string& word) {
  const auto* const input = std::ranges::find(kInputs, word, &Input::word);
  CHECK(input != std::end(kInputs));
  const ocio::GroupTransformRcPtr group = ocio::GroupTransform::Create();
  if (input->builtin != nullptr) {
    append_builtin(group, input->builtin, ocio::TRANSFORM_DIR_INVERSE);
    return group;
  }
  append_builtin(group, "ACEScg_to_ACES2065-1", ocio::TRANSFORM_DIR_INVERSE);
  append_builtin(group, "UTILITY - ACES-AP1_to_LINEAR-REC709_BFD", ocio::TRANSFORM_DIR_FORWARD);
  if (word == "logc4") append_logc4(group);
  if (word == "log2") {
    const ocio::LogTransformRcPtr log = ocio::LogTransform::Create();
    log->setBase(2.0);
    group->appendTransform(log);
  }
  return group;
}

// Takes low .. high to 0 .. 1.
void append_domain(const ocio::GroupTransformRcPtr& group, double low, double high) {
  const ocio::RangeTransformRcPtr range = ocio::RangeTransform::Create();
  range->setMinInValue(low);
  range->setMaxInValue(high);
  range->setMinOutValue(0.0);
  range->setMaxOutValue(1.0);
  group->appendTransform(range);
}

void add_space(const ocio::ConfigRcPtr& config, const char* name, const ocio::TransformRcPtr& from_scene) {
  const ocio::ColorSpaceRcPtr space = ocio::ColorSpace::Create();
  space->setName(name);
  if (from_scene) space->setTransform(from_scene, ocio::COLORSPACE_DIR_FROM_REFERENCE);
  config->addColorSpace(space);
}

}  // namespace

std::vector<std::string> lut_inputs() {
  std::vector<std::string> words;
  for (const Input& input : kInputs) words.emplace_back(input.word);
  return words;
}

namespace {

// A configuration whose only view shows scene light through the file of `choice`, which is a LUT. Throws
// OpenColorIO's exceptions if this version lacks the input space. `choice.lut_input` is one of the words. Any
// thread.
ocio::ConstConfigRcPtr lut_config(const ViewChoice& choice) {
  const ocio::ConfigRcPtr config = ocio::Config::Create();
  config->setMajorVersion(2);
  add_space(config, "ACES2065-1", nullptr);
  config->setRole(ocio::ROLE_INTERCHANGE_SCENE, "ACES2065-1");
  const ocio::GroupTransformRcPtr shown = to_input(choice.lut_input);
  if (choice.lut_domain) append_domain(shown, choice.lut_domain->first, choice.lut_domain->second);
  const ocio::FileTransformRcPtr file = ocio::FileTransform::Create();
  file->setSrc(std::filesystem::absolute(choice.config).c_str());
  file->setInterpolation(ocio::INTERP_BEST);
  shown->appendTransform(file);
  add_space(config, "through the LUT", shown);
  const std::string name = std::filesystem::path(choice.config).filename().string();
  config->addDisplayView("LUT", name.c_str(), "through the LUT", "");
  return config;
}

// OpenColorIO takes "0,25" as 0. Programs write such files where numbers have decimal commas. Looks at the
// beginning of the file: all numbers of a file are written alike. In XML, commas may stand between numbers.
absl::Status check_decimal_points(const std::string& path) {
  constexpr size_t kMostBytes = 1 << 20;
  std::string text(kMostBytes, '\0');
  std::ifstream file(path);
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<size_t>(file.gcount()));
  const size_t begin = text.find_first_not_of("\xef\xbb\xbf \t\r\n");  // a byte order mark may come first
  if (begin < text.size() && text[begin] == '<') return absl::OkStatus();
  size_t number = 0;
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    if (line.find_first_not_of("0123456789+-.,;eE \t\r") != absl::string_view::npos) continue;
    for (size_t at = line.find(','); at < line.size(); at = line.find(',', at + 1)) {
      const bool decimal = at > 0 && at + 1 < line.size() && absl::ascii_isdigit(line[at - 1]) &&
                           absl::ascii_isdigit(line[at + 1]);
      if (!decimal) continue;
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: line %d, \"%s\": numbers in a LUT have decimal points, not commas; write it "
                          "again with points",
                          path, number, absl::StripAsciiWhitespace(line.substr(0, 60))));
    }
  }
  return absl::OkStatus();
}

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
  if (!choice.lut_input.empty()) {
    RETURN_IF_ERROR(check_decimal_points(choice.config));
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
