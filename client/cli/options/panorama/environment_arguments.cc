#include "client/cli/options/panorama/environment_arguments.h"

#include <bit>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/picture_options.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/words/option_kinds.h"
#include "client/run/output_files.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr char kCube[] = "Cube map";
constexpr v1::Range<double> kLevels{1, 9};

// A word of an option and what it means.
template <typename Value>
using Words = std::vector<std::pair<std::string, Value>>;

template <typename Value>
absl::StatusOr<Value> value_of(const Words<Value>& words, const std::string& what, const std::string& typed) {
  std::vector<std::string> known;
  for (const auto& [word, value] : words) {
    if (absl::EqualsIgnoreCase(word, typed)) return value;
    known.push_back(word);
  }
  return unknown_word(what, typed, known);
}

// "HELP: one, two (default one)"
template <typename Value>
void add_words(CLI::App& app, const char* name, const std::string& help, const Words<Value>& words,
               Value& chosen) {
  std::vector<std::string> known;
  for (const auto& [word, value] : words) known.push_back(word);
  add_text(app, kCube, name, "NAME",
           absl::StrFormat("%s: %s (default %s)", help, absl::StrJoin(known, ", "), known.front()),
           [name, words, &chosen](const std::string& typed) {
             const absl::StatusOr<Value> value = value_of(words, std::string(name) + " word", typed);
             if (value.ok()) chosen = *value;
             return value.status();
           });
}

const Words<EnvironmentLayout>& layouts() {
  static const Words<EnvironmentLayout> words = {{"faces", EnvironmentLayout::kFaces},
                                                 {"cross", EnvironmentLayout::kCross},
                                                 {"equirectangular", EnvironmentLayout::kEquirectangular}};
  return words;
}

bool is_about_panoramas(const v1::SettingField& setting) {
  const std::string& flag = setting.declaration().flag();
  return flag == "primaries" || flag == "bad-values" || flag == "tier";
}

absl::Status set_size(EnvironmentOptions& options, const std::string& text) {
  const v1::Range<double> range{v1::kCubeSize.min, v1::kCubeSize.max};
  const absl::StatusOr<double> size = parse_number("--size", text, range, true);
  if (!size.ok()) return size.status();
  if (!std::has_single_bit(static_cast<uint32_t>(*size))) {
    return usage_error(
        absl::StrFormat("--size is %s; it must be a power of two, %s", text, format_range(range)));
  }
  options.size = static_cast<uint32_t>(*size);
  return absl::OkStatus();
}

void add_cube_options(CLI::App& app, EnvironmentArguments& arguments) {
  EnvironmentOptions& options = arguments.options;
  add_text(app, kCube, "--size", "N",
           absl::StrFormat(
               "Side of a face in texels: a power of two, %d .. %d (default: a quarter of the "
               "panorama's width, rounded up to a power of two, 16 .. 2048); 4096 needs --levels 1 and a "
               "server whose --memory-budget is at least 3GiB",
               v1::kCubeSize.min, v1::kCubeSize.max),
           [&options](const std::string& text) { return set_size(options, text); });
  add_text(app, kCube, "--levels", "N",
           absl::StrFormat("Number of levels; each is half the size of the one before, and rougher; %s "
                           "(default: all down to 16 x 16, or 1 for .exr)",
                           format_range(kLevels)),
           [&options](const std::string& text) {
             const absl::StatusOr<double> levels = parse_number("--levels", text, kLevels, true);
             if (levels.ok()) options.levels = static_cast<uint32_t>(*levels);
             return levels.status();
           });
  add_enum<v1::RoughnessMapping>(
      app, kCube, "--roughness-mapping", "roughness mapping", v1::ROUGHNESS_MAPPING_LINEAR,
      "Roughness of level i of n: i / (n - 1), or 1 - sqrt(1 - i / (n - 1))",
      [&options](v1::RoughnessMapping mapping) { options.roughness_mapping = mapping; });
  add_text(app, kCube, "--layout", "NAME",
           "Layout of the output: equirectangular (default) or cross for .exr; faces for .ktx2 and folders",
           arguments.layout);
  add_text(app, kCube, "--handedness", "left|right",
           "Handedness of the faces: left for KTX2 and three.js, right for Filament and Khronos' glTF "
           "viewer (default left)",
           [&arguments](const std::string& typed) {
             const absl::StatusOr<Handedness> hand = value_of<Handedness>(
                 {{"left", Handedness::kLeft}, {"right", Handedness::kRight}}, "handedness", typed);
             if (hand.ok()) arguments.options.handedness = *hand;
             arguments.handed = true;
             return hand.status();
           });
  add_rotation_option(app, kCube, options.rotation_deg);
  add_words<CubeFormat>(app, "--format", "Texel format",
                        {{name(CubeFormat::kRgba16f), CubeFormat::kRgba16f},
                         {name(CubeFormat::kRgb9e5), CubeFormat::kRgb9e5},
                         {name(CubeFormat::kRgba32f), CubeFormat::kRgba32f}},
                        options.format);
}

void add_files(CLI::App& app, EnvironmentOptions& options) {
  const auto add = [&app](const char* name, const char* extension, const std::string& help, std::string& to) {
    add_text(app, kOutputSection, name, absl::StrCat("FILE", extension), help,
             [name, extension, &to](const std::string& path) {
               const std::string has = std::filesystem::path(path).extension().string();
               if (absl::AsciiStrToLower(has) != extension) {
                 return usage_error(absl::StrFormat("%s is %s; it must end in %s", name, path, extension));
               }
               to = path;
               return absl::OkStatus();
             });
  };
  add("--sh", ".json", "Write the spherical harmonics of the radiance and the irradiance", options.harmonics);
  add("--preview", ".png", "Draw a sheet of the levels, rendered with the default settings but without bloom",
      options.preview);
}

// The layouts that the output can have; the first is the default.
absl::StatusOr<std::vector<EnvironmentLayout>> layouts_of(const std::string& output) {
  if (names_folder(output)) return std::vector{EnvironmentLayout::kFaces};
  const std::string extension = absl::AsciiStrToLower(std::filesystem::path(output).extension().string());
  if (extension == ".ktx2") return std::vector{EnvironmentLayout::kFaces};
  if (extension == ".exr") {
    return std::vector{EnvironmentLayout::kEquirectangular, EnvironmentLayout::kCross};
  }
  return usage_error(
      absl::StrFormat("%s: an environment is written as .ktx2, as .exr, or into a folder, such as %s/",
                      output, std::filesystem::path(output).stem().string()));
}

absl::Status choose_layout(EnvironmentArguments& arguments) {
  EnvironmentOptions& options = arguments.options;
  ASSIGN_OR_RETURN(const std::vector<EnvironmentLayout> possible, layouts_of(options.output));
  options.layout = possible.front();
  if (arguments.layout.empty()) return absl::OkStatus();
  const absl::StatusOr<EnvironmentLayout> layout = value_of(layouts(), "layout", arguments.layout);
  if (!layout.ok()) return layout.status();
  options.layout = *layout;
  for (const EnvironmentLayout one : possible) {
    if (one == *layout) return absl::OkStatus();
  }
  return usage_error(
      absl::StrFormat("--layout %s: %s cannot have it; .exr files are "
                      "equirectangular or cross, .ktx2 files and folders have faces",
                      arguments.layout, options.output));
}

}  // namespace

void add_environment_options(CLI::App& app, EnvironmentArguments& arguments) {
  EnvironmentOptions& options = arguments.options;
  app.add_option("PANO", options.panorama,
                 "Panorama in the equirectangular projection, twice as wide as high: OpenEXR, Radiance .hdr "
                 "or PFM")
      ->required()
      ->option_text(" ");
  app.add_option(
         "OUT", options.output,
         "A .ktx2 file with all levels; an .exr file, with further levels in NAME.level1.exr and so on; "
         "or a folder, DIR/, with six .exr faces for each level")
      ->required()
      ->option_text(" ");
  add_cube_options(app, arguments);
  add_choice_options(app, options);
  add_max_pixels_option(app, options);
  add_settings_options(app, options.settings, is_about_panoramas);
  add_files(app, options);
  app.add_flag("--verify", options.verify, "Measure each level's error against the float64 reference")
      ->group(kOutputSection);
  add_json_option(app, kOutputSection, "Write what was baked, and the times, as one line of JSON",
                  options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  options.server.bakes = true;
  add_servers_options(app, options.server);
}

absl::Status finish_environment_options(EnvironmentArguments& arguments) {
  EnvironmentOptions& options = arguments.options;
  RETURN_IF_ERROR(check_input_names({options.panorama}));
  RETURN_IF_ERROR(check_output_name(options.output));
  RETURN_IF_ERROR(choose_layout(arguments));
  if (!options.levels && options.layout != EnvironmentLayout::kFaces) options.levels = 1;
  if (arguments.handed && options.layout != EnvironmentLayout::kFaces) {
    options.notes.push_back("--handedness changes nothing: only faces have one");
  }
  return finish_server_options(options.server);
}

}  // namespace candela
