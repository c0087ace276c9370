// `candela sample`: a picture, a sequence or a panorama to try things with.
#include "client/image/sample.h"

#include <CLI/App.hpp>
#include <memory>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/options.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/terminal.h"
#include "client/image/write/encodings.h"
#include "client/run/output_files.h"
#include "client/run/sequence.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

absl::Status make_sequence(const SampleOptions& options) {
  ASSIGN_OR_RETURN(const OutputNames names, OutputNames::parse(options.sequence, ".exr"));
  RETURN_IF_ERROR(make_folder_of(names.path(0, "")));
  Progress progress(!options.quiet);
  for (uint64_t i = 0; i < options.frames; ++i) {
    progress.show_bar(static_cast<double>(i) / static_cast<double>(options.frames), names.path(i, ""));
    ASSIGN_OR_RETURN(const Image frame,
                     sample_sequence_frame(options.width, options.height, i, options.frames));
    if (const auto notes = write_image(names.path(i, ""), frame); !notes.ok()) return notes.status();
  }
  progress.clear();
  if (options.quiet) return absl::OkStatus();
  const std::string of = absl::StrFormat("%s .. %s", names.path(0, ""), names.path(options.frames - 1, ""));
  return print(absl::StrFormat(
      "%s: %d frames of %dx%d; the second half is 2^12 times brighter. To see the exposure adapt, run "
      "`candela stream %s out --exposure-plot exposure.svg`\n",
      escaped(of), options.frames, options.width, options.height, escaped(options.sequence)));
}

// Writes a scene or a panorama.
absl::Status write_picture(const SampleOptions& options, const std::string& path, Progress& progress) {
  progress.show("making the picture");
  const uint32_t width = options.width, height = options.height;
  ASSIGN_OR_RETURN(const Image image, options.panorama.empty()
                                          ? sample_scene(width, height)
                                          : scene_image(width, height, scenes::panorama(width, height)));
  progress.show("writing " + path);
  const absl::StatusOr<std::vector<std::string>> notes = write_image(path, image);
  progress.clear();
  if (!notes.ok()) return notes.status();
  if (options.quiet) return absl::OkStatus();
  for (const std::string& note : *notes) print_note(note);
  return absl::OkStatus();
}

constexpr uint32_t kSceneWidth = 1920, kSceneHeight = 1080;
constexpr uint32_t kPanoramaWidth = 1024, kPanoramaHeight = 512;

absl::Status run_sample(const SampleOptions& options) {
  if (!options.sequence.empty()) return make_sequence(options);
  const std::string path = options.output + options.panorama;  // one of them is empty
  RETURN_IF_ERROR(make_folder_of(path));
  if (const auto kind = check_output_path(path); !kind.ok()) return kind.status();
  Progress progress(!options.quiet);
  RETURN_IF_ERROR(write_picture(options, path, progress));
  if (options.quiet) return absl::OkStatus();
  if (!options.panorama.empty()) {
    return print(absl::StrFormat(
        "%s: %dx%d, a panorama with a sun of 65504. To look into it, run `candela view %s view.png`\n",
        escaped(path), options.width, options.height, escaped(path)));
  }
  return print(absl::StrFormat(
      "%s: %dx%d, with a sun of 1e5 and shadows of 1e-3. To view it, run `candela render %s scene.png`\n",
      escaped(path), options.width, options.height, escaped(path)));
}

constexpr char kSampleExamples[] =
    "Examples:\n"
    "  candela sample scene.exr --size 1280x720\n"
    "  candela sample --sequence in --frames 96\n"
    "  candela sample --panorama pano.exr";

void add_sample_options(CLI::App& app, SampleOptions& sample) {
  app.add_option("OUT", sample.output, "File to write: .exr or .pfm; not with --sequence or --panorama")
      ->option_text(" ");
  add_text(app, "Options", "--size", "WIDTHxHEIGHT",
           absl::StrFormat("Pixels; 1x1 .. %dx%d (default %dx%d, of a panorama %dx%d)", v1::kMaxDimension,
                           v1::kMaxDimension, kSceneWidth, kSceneHeight, kPanoramaWidth, kPanoramaHeight),
           [&sample](const std::string& text) { return parse_size(text, sample.width, sample.height); });
  add_text(
      app, "Options", "--sequence", "DIR|PATTERN",
      "Write a sequence instead, to a folder or to a pattern such as in/%04d.exr; in the middle its light "
      "changes by a factor of 2^12",
      sample.sequence);
  add_text(
      app, "Options", "--panorama", "FILE",
      "Write a panorama instead, .exr or .pfm: sky, sun and ground, and at each quarter of the horizon a "
      "wall of another colour",
      sample.panorama);
  add_number(
      app, "Options", "--frames", "N", {2, 100000}, static_cast<double>(sample.frames),
      "Frames of the sequence", [&sample](double n) { sample.frames = static_cast<uint64_t>(n); }, true);
  add_quiet_option(app, "Options", sample.quiet);
}

absl::Status finish_sample_options(SampleOptions& sample) {
  if (!sample.output.empty() + !sample.sequence.empty() + !sample.panorama.empty() != 1) {
    return usage_error(
        "sample makes a scene, a sequence or a panorama: give "
        "OUT, --sequence DIR or --panorama FILE, one of them");
  }
  if (sample.width == 0) {
    sample.width = sample.panorama.empty() ? kSceneWidth : kPanoramaWidth;
    sample.height = sample.panorama.empty() ? kSceneHeight : kPanoramaHeight;
  }
  std::string path = sample.output + sample.panorama;
  RETURN_IF_ERROR(check_output_name(path + sample.sequence));
  if (!sample.sequence.empty()) {
    ASSIGN_OR_RETURN(const OutputNames names, OutputNames::parse(sample.sequence, ".exr"));
    path = names.path(0, "");
  }
  if (const auto found = output_encoding(path); found.ok() && (*found)->holds_light())
    return absl::OkStatus();
  return usage_error(absl::StrFormat("%s: a scene is written as %s; `candela render` makes a .png of it",
                                     path, extensions_with(&OutputEncoding::holds_light)));
}

Finish define_sample(CLI::App& app) {
  const auto options = std::make_shared<SampleOptions>();
  add_sample_options(app, *options);
  return [options](const GivenOptions&) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_sample_options(*options));
    return parsed_command(*options, run_sample);
  };
}

}  // namespace

const Command kSampleCommand{"sample", "Makes a procedural HDR scene, a sequence of them, or a panorama.",
                             kSampleExamples, define_sample};

}  // namespace candela
