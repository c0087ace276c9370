#include "absl/strings/str_format.h"
#include "client/cli/commands/commands.h"
#include "client/cli/files/output_files.h"
#include "client/cli/files/scene_image.h"
#include "client/cli/files/sequence_files.h"
#include "client/cli/files/terminal.h"
#include "client/image/sample.h"

namespace candela {
namespace {

absl::Status make_sequence(const SampleOptions& options) {
  const absl::StatusOr<OutputNames> names = OutputNames::parse(options.sequence, ".exr");
  if (!names.ok()) return names.status();
  if (absl::Status status = make_folder_of(names->path(0, "")); !status.ok()) return status;
  Progress progress(!options.quiet);
  for (uint64_t i = 0; i < options.frames; ++i) {
    progress.show_bar(static_cast<double>(i) / static_cast<double>(options.frames), names->path(i, ""));
    const absl::StatusOr<Image> frame =
        sample_sequence_frame(options.width, options.height, i, options.frames);
    if (!frame.ok()) return frame.status();
    if (const auto notes = write_image(names->path(i, ""), *frame); !notes.ok()) return notes.status();
  }
  progress.clear();
  if (options.quiet) return absl::OkStatus();
  const std::string of = absl::StrFormat("%s .. %s", names->path(0, ""), names->path(options.frames - 1, ""));
  return print(absl::StrFormat(
      "%s: %d frames of %dx%d; the second half is 2^12 times brighter. To see the exposure adapt, run "
      "`candela stream %s out --exposure-plot exposure.svg`\n",
      escaped(of), options.frames, options.width, options.height, escaped(options.sequence)));
}

// Writes a scene or a panorama.
absl::Status write_picture(const SampleOptions& options, const std::string& path, Progress& progress) {
  progress.show("making the picture");
  const uint32_t width = options.width, height = options.height;
  const absl::StatusOr<Image> image = options.panorama.empty()
                                          ? sample_scene(width, height)
                                          : scene_image(width, height, scenes::panorama(width, height));
  if (!image.ok()) return image.status();
  progress.show("writing " + path);
  const absl::StatusOr<std::vector<std::string>> notes = write_image(path, *image);
  progress.clear();
  if (!notes.ok()) return notes.status();
  if (options.quiet) return absl::OkStatus();
  for (const std::string& note : *notes) print_note(note);
  return absl::OkStatus();
}

}  // namespace

absl::Status run_sample(const SampleOptions& options) {
  if (!options.sequence.empty()) return make_sequence(options);
  const std::string path = options.output + options.panorama;  // one of them is empty
  if (absl::Status status = make_folder_of(path); !status.ok()) return status;
  if (const auto kind = check_output_path(path); !kind.ok()) return kind.status();
  Progress progress(!options.quiet);
  if (absl::Status status = write_picture(options, path, progress); !status.ok()) return status;
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

}  // namespace candela
