// `candela environment`: bakes a panorama into files.
#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <bit>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "candela/v1/render.pb.h"
#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/json_output.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/render_report.h"
#include "client/cli/run_display.h"
#include "client/cli/terminal.h"
#include "client/environment/environment_files.h"
#include "client/environment/pictures.h"
#include "client/image/read_formats.h"
#include "client/image/write/atomic_file.h"
#include "client/run/options.h"
#include "client/run/output_files.h"
#include "client/run/panorama_file.h"
#include "client/run/picture_frame.h"
#include "client/run/report.h"
#include "client/run/run.h"
#include "client/run/server_link.h"
#include "proto/candela/v1/pixel_size.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

struct EnvironmentReport {
  v1::Environment panorama;  // as the server keeps it
  PrimariesUsed primaries;
  v1::BakeHeader bake;
  uint64_t missing_pixels = 0;  // of the panorama's file
  // In this order: read, start, put, the server's stages of the bake, other, write, and preview if there is
  // one. `other` is the part of the bake's call outside the server's stages.
  StageMs stage_ms;
  double total_ms = 0;
  std::vector<std::string> files;  // all that were written
  std::vector<std::string> notes;
};

using Json = nlohmann::ordered_json;

const char* word_of(EnvironmentLayout layout) {
  return layout == EnvironmentLayout::kFaces   ? "faces"
         : layout == EnvironmentLayout::kCross ? "cross"
                                               : "equirectangular";
}

Json levels_of(const v1::BakeHeader& bake) {
  Json levels = Json::array();
  for (const v1::BakedLevel& level : bake.levels()) {
    Json row{{"size", level.size()}, {"roughness", level.roughness()}};
    if (level.has_error()) row["error"] = level.error();
    levels.push_back(std::move(row));
  }
  return levels;
}

Json losses_of(const v1::BakeHeader& bake) {
  return {{"negative", bake.negative_components()}, {"clamped", bake.clamped_components()}};
}

// "; errors 0.01% 0.42% ..." of the levels, if they were measured.
std::string errors_of(const v1::BakeHeader& bake) {
  std::string errors;
  for (const v1::BakedLevel& level : bake.levels()) {
    if (level.has_error()) absl::StrAppend(&errors, " ", in_digits(100 * level.error(), 2), "%");
  }
  return errors.empty() ? "" : "; errors" + errors;
}

// A note that counts the components that the format cannot hold; empty if there are none.
std::string losses_note(const v1::BakeHeader& bake, CubeFormat format) {
  if (bake.negative_components() + bake.clamped_components() == 0) return "";
  if (format == CubeFormat::kRgba16f) {
    return absl::StrFormat(
        "rgba16f holds up to 65504: %d component%s beyond that became that; --format rgba32f keeps them",
        bake.clamped_components(), bake.clamped_components() == 1 ? "" : "s");
  }
  return absl::StrFormat(
      "rgb9e5 holds 0 .. %.0f: %d negative components became 0, and %d larger ones became that largest value",
      v1::kMaxRgb9e5, bake.negative_components(), bake.clamped_components());
}

// One line, with a line end.
std::string to_text(const EnvironmentReport& report, const EnvironmentOptions& options) {
  const int levels = report.bake.levels_size();
  const bool faces = options.layout == EnvironmentLayout::kFaces;
  return absl::StrFormat("%s -> %s: %dx%d, %d level%s, %s, %s%s%s; %s; %.2f s\n", escaped(options.panorama),
                         escaped(options.output), report.bake.size(), report.bake.size(), levels,
                         levels == 1 ? "" : "s", word_of(options.layout), name(options.format),
                         faces ? absl::StrFormat(", %s-handed", name(options.handedness)) : "",
                         errors_of(report.bake), words_of(report.primaries), report.total_ms / 1000);
}

// One object on one line, with the keys input, output, id, panorama {width, height}, primaries {name, xy,
// from}, layout, format, handedness (null without faces), rotation_deg, roughness_mapping, size, levels
// [{size, roughness, error}], tier, had_it (the server had the panorama), bad_values {nan, inf, negative} and
// clamped_components of the panorama, missing_pixels of its file, losses {negative, clamped} of the faces in
// their format, files (all that were written, a folder for its faces), stage_ms, total_ms, notes.
std::string to_json(const EnvironmentReport& report, const EnvironmentOptions& options) {
  const v1::Environment& panorama = report.panorama;
  Json handedness, stages = Json::object();
  if (options.layout == EnvironmentLayout::kFaces) handedness = name(options.handedness);
  for (const auto& [stage, ms] : report.stage_ms) stages[stage] = ms;
  const Json json = {{"input", options.panorama},
                     {"output", options.output},
                     {"id", panorama.id()},
                     {"panorama", {{"width", panorama.width()}, {"height", panorama.height()}}},
                     {"primaries", to_json(report.primaries)},
                     {"layout", word_of(options.layout)},
                     {"format", name(options.format)},
                     {"handedness", handedness},
                     {"rotation_deg", options.rotation_deg},
                     {"roughness_mapping", v1::word_of(options.roughness_mapping)},
                     {"size", report.bake.size()},
                     {"levels", levels_of(report.bake)},
                     {"tier", report.bake.tier()},
                     {"had_it", panorama.had_it()},
                     {"bad_values", bad_values_json(panorama)},
                     {"clamped_components", panorama.clamped_components()},
                     {"missing_pixels", report.missing_pixels},
                     {"losses", losses_of(report.bake)},
                     {"files", report.files},
                     {"stage_ms", stages},
                     {"total_ms", report.total_ms},
                     {"notes", report.notes}};
  // A path may not be UTF-8, so invalid bytes are replaced.
  return line_of(json);
}

// The options of `candela environment`.

// The options as parsed, before they are combined and checked.
struct EnvironmentArguments {
  EnvironmentOptions options;
  std::string layout;   // "" if not given
  bool handed = false;  // --handedness is given
};

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
  const std::string extension = extension_of(output);
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

// Defines the options; parsing fills `arguments`, which outlives the app.
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

// After parsing: chooses the output's format and refuses options that conflict.
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

// The bake, and its files.

namespace fs = std::filesystem;

// Ends the wait for a server that never answers.
constexpr absl::Duration kBakeTimeout = absl::Minutes(30);

constexpr uint32_t kSmallestLevel = 16;  // texels along a face's side

bool has_faces(const EnvironmentOptions& options) { return options.layout == EnvironmentLayout::kFaces; }

bool is_ktx2(const EnvironmentOptions& options) {
  std::error_code failed;
  return has_faces(options) && !fs::is_directory(options.output, failed) &&
         extension_of(options.output) == ".ktx2";
}

// The picture of a level: OUT.exr, OUT.level1.exr, ...
std::string picture_path(const EnvironmentOptions& options, size_t level) {
  if (level == 0) return options.output;
  const fs::path path(options.output);
  const std::string name =
      absl::StrFormat("%s.level%d%s", path.stem().string(), level, path.extension().string());
  return (path.parent_path() / name).string();
}

// The folder of the faces, without a slash at its end.
std::string folder_of(const EnvironmentOptions& options) {
  const fs::path path(options.output);
  return (path.has_filename() ? path : path.parent_path()).string();
}

// INVALID_ARGUMENT for more levels than a cube map of this size has.
absl::Status check_levels(uint32_t levels, uint32_t size) {
  uint32_t most = 1;
  for (uint32_t side = size; side > kSmallestLevel; side /= 2) ++most;
  if (levels <= most) return absl::OkStatus();
  return usage_error(absl::StrFormat("--levels is %d; a cube map of %dx%d has %d, down to %dx%d", levels,
                                     size, size, most, kSmallestLevel, kSmallestLevel));
}

class EnvironmentJob {
 public:
  EnvironmentJob(const EnvironmentOptions& options, RunEvents& events)
      : options_(options), events_(events), run_(options, events) {}

  absl::StatusOr<EnvironmentReport> run() {
    report_.notes = options_.notes;
    absl::Status status = read();
    if (status.ok()) status = run_.connect();
    if (status.ok() && run_.start_ms() > 0) add_stage("start", run_.start_ms());
    if (status.ok()) status = bake();
    if (status.ok()) status = write();
    if (status.ok()) status = preview();
    if (!status.ok()) return status;
    run_.close();
    report_.total_ms = ms_since(begin_);
    return std::move(report_);
  }

 private:
  absl::Status read() {
    events_.begins("reading " + options_.panorama);
    ASSIGN_OR_RETURN(const v1::Limits limits, run_.limits());
    const absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(PanoramaFile file, read_panorama(options_.panorama, options_, limits));
    add_stage("read", ms_since(begin));
    report_.primaries = file.primaries;
    report_.missing_pixels = file.missing_pixels;
    std::move(file.notes.begin(), file.notes.end(), std::back_inserter(report_.notes));
    panorama_ = std::move(file.panorama);
    return absl::OkStatus();
  }

  absl::Status bake() {
    const absl::Time deadline = absl::Now() + kBakeTimeout;
    absl::StatusOr<EnvironmentBake> bake;
    const absl::Status status = run_.link().call(deadline, [&](const Connection& server) {
      bake = bake_on(server, deadline);
      return bake.status();
    });
    if (!status.ok()) return name_file(in_options(status, options_.settings), options_.panorama);
    panorama_.reset();
    report_.bake = bake->header;
    const std::string bad = bad_values_note(report_.panorama);
    if (!bad.empty()) report_.notes.push_back(bad);
    const std::string losses = losses_note(report_.bake, options_.format);
    if (!losses.empty()) report_.notes.push_back(losses);
    ASSIGN_OR_RETURN(environment_, environment_from(*bake, options_.handedness));
    return absl::OkStatus();
  }

  // Both calls go to the same server, because another one may not have the panorama.
  absl::StatusOr<EnvironmentBake> bake_on(const Connection& server, absl::Time deadline) {
    events_.begins("sending " + options_.panorama);
    absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(const v1::Environment put, server.put_environment(*panorama_, deadline));
    report_.panorama = put;
    const double put_ms = ms_since(begin);
    const uint32_t size = options_.size == 0 ? put.default_cube_size() : options_.size;
    RETURN_IF_ERROR(check_levels(options_.levels.value_or(1), size));
    events_.begins(absl::StrFormat("baking a cube map of %dx%d", size, size));
    begin = absl::Now();
    absl::StatusOr<EnvironmentBake> bake = server.bake_environment(request(put.id()), deadline);
    if (bake.ok()) {
      add_stage("put", put_ms);
      add_server_stages(bake->header, ms_since(begin), report_.stage_ms);
    }
    return bake;
  }

  v1::BakeEnvironmentRequest request(const std::string& id) const {
    v1::BakeEnvironmentRequest request;
    request.set_id(id);
    request.set_size(options_.size);
    request.set_levels(options_.levels.value_or(0));
    request.set_roughness_mapping(options_.roughness_mapping);
    request.set_rotation_deg(options_.rotation_deg);
    request.set_format(options_.format == CubeFormat::kRgb9e5    ? v1::PIXEL_FORMAT_RGB9E5
                       : options_.format == CubeFormat::kRgba32f ? v1::PIXEL_FORMAT_RGBA32F
                                                                 : v1::PIXEL_FORMAT_RGBA16F);
    request.set_tier(options_.settings.tier());
    request.set_verify(options_.verify);
    return request;
  }

  absl::Status write() {
    events_.begins("writing " + options_.output);
    const absl::Time begin = absl::Now();
    absl::Status status = is_ktx2(options_)     ? write_ktx2(options_.output, environment_)
                          : has_faces(options_) ? write_face_files(folder_of(options_), environment_)
                                                : write_pictures();
    if (!status.ok()) return status;
    report_.files.insert(report_.files.begin(), options_.output);
    if (!options_.harmonics.empty()) {
      status = write_harmonics(options_.harmonics, environment_.harmonics);
      report_.files.push_back(options_.harmonics);
    }
    add_stage("write", ms_since(begin));
    return status;
  }

  absl::Status write_pictures() {
    for (size_t level = 0; level < environment_.levels.size(); ++level) {
      ASSIGN_OR_RETURN(const Image picture, options_.layout == EnvironmentLayout::kCross
                                                ? cross_picture(environment_, level)
                                                : equirectangular_picture(environment_, level));
      const std::string path = picture_path(options_, level);
      if (const auto notes = write_image(path, picture); !notes.ok()) return notes.status();
      if (level > 0) report_.files.push_back(path);
    }
    return absl::OkStatus();
  }

  // The levels as a frame, which the server renders.
  absl::Status preview() {
    if (options_.preview.empty()) return absl::OkStatus();
    events_.begins("writing " + options_.preview);
    const absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(const Image sheet, environment_preview(environment_));
    absl::StatusOr<RenderResult> result;
    const absl::Status status = run_.link().call(begin + kBakeTimeout, [&](const Connection& server) {
      result = server.render(preview_settings(), view_of(sheet), begin + kBakeTimeout);
      return result.status();
    });
    if (!status.ok()) return reworded(status, absl::StrFormat("%s: %s", options_.preview, status.message()));
    const Image picture = picture_of(*std::move(result), /*has_alpha=*/false, /*pixel_aspect=*/1);
    if (const auto notes = write_image(options_.preview, picture); !notes.ok()) return notes.status();
    report_.files.push_back(options_.preview);
    add_stage("preview", ms_since(begin));
    return absl::OkStatus();
  }

  void add_stage(const std::string& name, double ms) { report_.stage_ms.emplace_back(name, ms); }

  const absl::Time begin_ = absl::Now();
  const EnvironmentOptions& options_;
  RunEvents& events_;
  Run run_;
  std::shared_ptr<const Panorama> panorama_;
  BakedEnvironment environment_;
  EnvironmentReport report_;
};

void add_faces(const std::string& folder, std::vector<OutputFile>& outputs) {
  for (const char* face : {"px", "nx", "py", "ny", "pz", "nz"}) {
    outputs.push_back({absl::StrFormat("%s/%s.exr", folder, face), "the faces"});
  }
}

// The files that will be written, as far as they are known before the bake.
std::vector<OutputFile> outputs_of(const EnvironmentOptions& options) {
  std::vector<OutputFile> outputs = {
      {options.harmonics, "the harmonics"}, {options.preview, "the preview"}, {options.json, "the JSON"}};
  if (!has_faces(options)) {
    for (uint32_t level = 0; level < *options.levels; ++level) {
      outputs.push_back({picture_path(options, level), "the environment"});
    }
  } else if (is_ktx2(options)) {
    outputs.push_back({options.output, "the environment"});
  } else {
    add_faces(folder_of(options), outputs);
  }
  return outputs;
}

// The faces of the further levels that a bake may have.
std::vector<OutputFile> further_faces_of(const EnvironmentOptions& options) {
  std::vector<OutputFile> outputs;
  if (!has_faces(options) || is_ktx2(options)) return outputs;
  for (uint32_t level = 1; v1::kCubeSize.max >> level >= kSmallestLevel; ++level) {
    add_faces(absl::StrFormat("%s/level%d", folder_of(options), level), outputs);
  }
  return outputs;
}

// Checks the files to write before the work, and makes their folders.
absl::Status prepare_outputs(const EnvironmentOptions& options) {
  std::vector<std::string> inputs = files_of(options.server);
  inputs.push_back(options.panorama);
  const std::vector<OutputFile> outputs = outputs_of(options);
  std::vector<OutputFile> possible = further_faces_of(options);
  possible.insert(possible.begin(), outputs.begin(), outputs.end());
  RETURN_IF_ERROR(check_outputs_apart(inputs, possible));
  for (const OutputFile& output : outputs) {
    if (output.path.empty() || output.path == options.json) continue;
    RETURN_IF_ERROR(make_folder_of(output.path));
    if (const auto there = writable_destination(output.path); !there.ok()) return there.status();
  }
  return absl::OkStatus();
}

absl::Status run_environment(const EnvironmentOptions& options, JsonOutput& json) {
  RETURN_IF_ERROR(prepare_outputs(options));
  RETURN_IF_ERROR(json.open());
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  RunDisplay display(options.quiet, json, progress);
  const absl::StatusOr<EnvironmentReport> report = EnvironmentJob(options, display).run();
  progress.clear();
  if (!report.ok()) return about_input(report.status(), options.panorama);
  if (!options.quiet) {
    for (const std::string& note : report->notes) print_note(note);
    if (!json.to_stdout()) {
      RETURN_IF_ERROR(print(to_text(*report, options)));
    }
  }
  return json.write(to_json(*report, options));
}

constexpr char kEnvironmentExamples[] =
    "Examples:\n"
    "  candela environment pano.hdr pano.ktx2 --sh pano.json --preview pano.png\n"
    "  candela environment pano.hdr pano.ktx2 --handedness right --roughness-mapping perceptual\n"
    "  candela environment pano.exr faces/ --size 512\n"
    "  candela environment pano.exr cross.exr --layout cross";

Finish define_environment(CLI::App& app) {
  const auto arguments = std::make_shared<EnvironmentArguments>();
  add_environment_options(app, *arguments);
  return [arguments](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_environment_options(*arguments));
    add_idle_notes(arguments->options, {.given = given});
    return parsed_command(arguments->options, run_environment);
  };
}

}  // namespace

const Command kEnvironmentCommand{
    "environment", "Bakes a panorama into a cube map with specular levels, for renderers and engines.",
    kEnvironmentExamples, define_environment};

}  // namespace candela
