// `candela environment`: the cube map of a panorama as files.
#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <thread>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/base/usage.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/environment/environment_report.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/command_line.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/panorama/environment_arguments.h"
#include "client/cli/results/run_display.h"
#include "client/environment/environment_files.h"
#include "client/environment/pictures.h"
#include "client/image/write/atomic_file.h"
#include "client/run/frame_files.h"
#include "client/run/output_files.h"
#include "client/run/panorama_file.h"
#include "client/run/report.h"
#include "client/run/run.h"
#include "client/run/server_link.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {
namespace fs = std::filesystem;

// Ends the wait for a server that never answers.
constexpr absl::Duration kBakeTimeout = absl::Minutes(30);

constexpr uint32_t kSmallestLevel = 16;  // texels along a face's side

bool has_faces(const EnvironmentOptions& options) { return options.layout == EnvironmentLayout::kFaces; }

bool is_ktx2(const EnvironmentOptions& options) {
  std::error_code failed;
  return has_faces(options) && !fs::is_directory(options.output, failed) &&
         absl::AsciiStrToLower(fs::path(options.output).extension().string()) == ".ktx2";
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
