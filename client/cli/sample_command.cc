#include "absl/strings/str_format.h"
#include "client/cli/commands.h"
#include "client/cli/terminal.h"
#include "client/image/sample.h"

namespace candela {

absl::Status run_sample(const SampleOptions& options) {
  if (const auto kind = check_output_path(options.output); !kind.ok()) return kind.status();
  Progress progress(!options.quiet);
  progress.show("making the scene");
  const absl::StatusOr<Image> scene = sample_scene(options.width, options.height);
  if (!scene.ok()) return scene.status();
  progress.show("writing " + options.output);
  const absl::StatusOr<std::vector<std::string>> notes = write_image(options.output, *scene);
  progress.clear();
  if (!notes.ok()) return notes.status();
  if (options.quiet) return absl::OkStatus();
  for (const std::string& note : *notes) print_note(note);
  return print(
      absl::StrFormat("%s: %dx%d, a sun of 1e5 and shadows of 1e-3; `candela render %s scene.png` shows it\n",
                      options.output, options.width, options.height, options.output));
}

}  // namespace candela
