#include "client/cli/options/sequence/sequence_options.h"

#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/base/usage.h"
#include "client/cli/options/sequence/session_options.h"
#include "client/cli/options/words/option_kinds.h"

namespace candela {
namespace {

// Stores what was parsed, or returns why it could not be.
template <typename Parsed, typename Stored>
absl::Status store(absl::StatusOr<Parsed> parsed, Stored& stored) {
  if (!parsed.ok()) return parsed.status();
  stored = *std::move(parsed);
  return absl::OkStatus();
}

absl::Status parse_missing(const std::string& word, MissingFrames& missing) {
  const std::pair<const char*, MissingFrames> words[] = {
      {"error", MissingFrames::kError}, {"skip", MissingFrames::kSkip}, {"hold", MissingFrames::kHold}};
  std::vector<std::string> known;
  for (const auto& [name, value] : words) {
    if (absl::EqualsIgnoreCase(word, name)) {
      missing = value;
      return absl::OkStatus();
    }
    known.emplace_back(name);
  }
  return unknown_word("choice for --missing", word, known);
}

}  // namespace

void add_sequence_options(CLI::App& app, const std::string& section, SequenceChoice& choice) {
  add_text(app, section, "--range", "RANGE",
           "Frame numbers to take: 12, 100-200, -10--5, 100-200x2 (every second), 100- (to the last), or "
           "several with "
           "commas between them (default: from the first file to the last)",
           [&choice](const std::string& text) {
             return store(parse_number_ranges("--range", text), choice.range);
           });
  add_text(
      app, section, "--missing", "NAME",
      "Frame numbers without a file: error, skip (no image), hold (the image of the frame before; beside "
      "--skip-bad also for bad frames) (default error)",
      [&choice](const std::string& text) { return parse_missing(text, choice.missing); });
  add_text(app, section, "--cut-at", "N,N,...", "Numbers of frames that begin a scene, where exposure jumps",
           [&choice](const std::string& text) {
             return store(parse_frame_numbers("--cut-at", text), choice.cuts);
           });
  add_text(
      app, section, "--fps", "FPS",
      absl::StrFormat("Frames a second of media time, such as 25 or 24000/1001; %s (default: the "
                      "framesPerSecond of the first OpenEXR file, else 24)",
                      format_range(kFps)),
      [&choice](const std::string& text) { return store(parse_frame_rate("--fps", text), choice.rate); });
}

}  // namespace candela
