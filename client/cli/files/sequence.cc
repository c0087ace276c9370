#include "client/cli/files/sequence.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/files/sequence_files.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {
namespace fs = std::filesystem;

constexpr size_t kMostRangesSaid = 8;

// The files by their frames' numbers.
struct Found {
  std::map<uint64_t, std::string> files;
  std::optional<NamePattern> names;  // without it the numbers count the files
};

// The numbers in the names of all files.
struct Numbering {
  std::vector<uint64_t> numbers;
  NamePattern names;
};

// A file's path without its extension, because files of one sequence may have several formats.
struct Stem {
  std::string folder, name;
};

Stem stem_of(const std::string& path) {
  const fs::path normal = fs::path(path).lexically_normal();
  return {normal.parent_path().string(), normal.stem().string()};
}

// The numbers between the first `before` and the last `after` characters of all names. Nothing if the folders
// differ, or the text around the number.
std::optional<std::vector<uint64_t>> numbers_between(const std::vector<Stem>& stems, size_t before,
                                                     size_t after) {
  const Stem& first = stems.front();
  const std::string head = first.name.substr(0, before), tail = first.name.substr(first.name.size() - after);
  std::vector<uint64_t> numbers;
  for (const Stem& stem : stems) {
    const std::optional<uint64_t> number = number_between(stem.name, before, after);
    if (!number || stem.folder != first.folder || !absl::StartsWith(stem.name, head) ||
        !absl::EndsWith(stem.name, tail)) {
      return std::nullopt;
    }
    numbers.push_back(*number);
  }
  return numbers;
}

// Takes the last run of digits that has the same text around it in all names.
std::optional<Numbering> common_numbering(const std::vector<std::string>& paths) {
  std::vector<Stem> stems;
  for (const std::string& path : paths) stems.push_back(stem_of(path));
  const std::string& name = stems.front().name;
  for (size_t end = name.size(); end > 0; --end) {
    if (!absl::ascii_isdigit(name[end - 1]) || (end < name.size() && absl::ascii_isdigit(name[end])))
      continue;
    size_t begin = end - 1;
    while (begin > 0 && absl::ascii_isdigit(name[begin - 1])) --begin;
    std::optional<std::vector<uint64_t>> numbers = numbers_between(stems, begin, name.size() - end);
    if (!numbers) continue;
    const std::string& path = paths.front();
    const size_t at = path.size() - fs::path(path).filename().string().size();
    size_t digits = end - begin;
    for (const Stem& stem : stems)
      digits = std::min(digits, stem.name.size() - (name.size() - (end - begin)));
    return Numbering{*std::move(numbers),
                     {path.substr(0, at + begin), path.substr(at + end), static_cast<int>(digits)}};
  }
  return std::nullopt;
}

// The numbering that the user gave by a pattern. find_frames() has found the paths by it.
Numbering numbering_by(const NamePattern& pattern, const std::vector<std::string>& paths) {
  Numbering numbering{{}, pattern};
  const size_t before = pattern.before.size(), after = pattern.after.size();
  size_t digits = kMostDigits;
  for (const std::string& path : paths) {
    numbering.numbers.push_back(*number_between(path, before, after));
    digits = std::min(digits, path.size() - before - after);
  }
  numbering.names.digits = static_cast<int>(digits);
  return numbering;
}

absl::StatusOr<Found> find(const std::vector<std::string>& inputs) {
  const absl::StatusOr<std::vector<std::string>> paths = find_frames(inputs);
  if (!paths.ok()) return paths.status();
  std::optional<Numbering> numbering;
  if (inputs.size() == 1) {
    const absl::StatusOr<std::optional<NamePattern>> pattern = input_pattern(inputs.front());
    if (!pattern.ok()) return pattern.status();
    if (*pattern) numbering = numbering_by(**pattern, *paths);
  }
  if (!numbering) numbering = common_numbering(*paths);
  Found found;
  if (numbering) found.names = numbering->names;
  for (size_t i = 0; i < paths->size(); ++i) {
    const uint64_t number = numbering ? numbering->numbers[i] : i;
    const auto [other, fresh] = found.files.emplace(number, (*paths)[i]);
    if (!fresh) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s and %s are both frame %d; give a pattern that only one of them fits, such as "
                          "in/frame.%%04d.exr",
                          other->second, (*paths)[i], number));
    }
  }
  return found;
}

// The distance of the numbers if it is the same between all files and above 1, else 1.
uint64_t step_of(const std::map<uint64_t, std::string>& files) {
  if (files.size() < 3) return 1;
  const uint64_t step = std::next(files.begin())->first - files.begin()->first;
  for (auto at = files.begin(), next = std::next(at); next != files.end(); ++at, ++next) {
    if (next->first - at->first != step) return 1;
  }
  return step;
}

std::string frames_are(const std::vector<NumberRange>& missing) {
  const std::string text = to_text(missing, ", ", kMostRangesSaid);
  return count_of(missing) == 1 ? absl::StrFormat("frame %s is", text)
                                : absl::StrFormat("frames %s are", text);
}

absl::Status missing_error(const SequenceChoice& choice, const Found& found, const Sequence& sequence) {
  const uint64_t step = choice.range.empty() ? step_of(found.files) : 1;
  std::string hint;
  if (step > 1) {
    hint = absl::StrFormat("--range %s takes the frames in steps of %d, ",
                           to_text({{sequence.first(), sequence.last(), step}}), step);
  } else if (choice.range.empty() && count_of(sequence.missing) > found.files.size()) {
    hint = "`candela render IN... OUTDIR/` renders stills each for itself, ";
  }
  return absl::NotFoundError(absl::StrFormat(
      "%s: %s missing; %s--missing skip renders the others, --missing hold repeats the frame "
      "before",
      found.names ? found.names->text() : choice.inputs.front(), frames_are(sequence.missing), hint));
}

// Puts the chosen frames and the missing numbers into the sequence.
absl::Status choose(const SequenceChoice& choice, const Found& found, Sequence& sequence) {
  const uint64_t first = found.files.begin()->first, last = found.files.rbegin()->first;
  if (choice.range.empty()) {
    uint64_t next = first;
    for (const auto& [number, path] : found.files) {
      if (number > next) sequence.missing.push_back({next, number - 1, 1});
      next = number + 1;
      sequence.frames.push_back({.number = number, .path = path});
    }
    return absl::OkStatus();
  }
  const absl::StatusOr<std::vector<uint64_t>> chosen = numbers_in(choice.range, last);
  if (!chosen.ok()) return chosen.status();
  std::vector<uint64_t> missing;
  for (const uint64_t number : *chosen) {
    const auto at = found.files.find(number);
    if (at == found.files.end()) {
      missing.push_back(number);
    } else {
      sequence.frames.push_back({.number = number, .path = at->second});
    }
  }
  sequence.missing = ranges_of(missing);
  if (!sequence.frames.empty()) return absl::OkStatus();
  return absl::NotFoundError(absl::StrFormat("--range %s: there is no such frame; there are frames %d to %d",
                                             to_text(choice.range), first, last));
}

// Gives every missing number to the frame before it.
absl::Status hold(Sequence& sequence) {
  if (count_of(sequence.missing) > kMostNumbers) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "%s missing, and --missing hold repeats at most %d frames; give --range or --missing skip",
        frames_are(sequence.missing), kMostNumbers));
  }
  size_t at = 0;
  for (const NumberRange& range : sequence.missing) {
    for (uint64_t number = range.first; number <= range.last; ++number) {
      if (number < sequence.first()) {
        return absl::NotFoundError(absl::StrFormat(
            "frame %d is missing, and no frame before it can be repeated; begin --range at %d, or "
            "give --missing skip",
            number, sequence.first()));
      }
      while (at + 1 < sequence.frames.size() && sequence.frames[at + 1].number < number) ++at;
      sequence.frames[at].holds.push_back(number);
    }
  }
  return absl::OkStatus();
}

// A scene begins at the first frame that is not before the cut's number, because that frame may be missing or
// not chosen. Cuts before the first chosen frame belong to another part of the sequence.
absl::Status mark_cuts(const SequenceChoice& choice, const Found& found, uint64_t first_chosen,
                       Sequence& sequence) {
  const uint64_t first = found.files.begin()->first, last = found.files.rbegin()->first;
  for (const uint64_t cut : choice.cuts) {
    if (cut < first || cut > last) {
      // Beside an exposure file a machine may have only its own part of the files.
      if (choice.zero && cut >= *choice.zero) continue;
      return absl::InvalidArgumentError(absl::StrFormat(
          "--cut-at %d: there is no such frame; there are frames %d to %d", cut, first, last));
    }
    if (cut < first_chosen) continue;
    const auto at =
        std::lower_bound(sequence.frames.begin(), sequence.frames.end(), cut,
                         [](const SequenceFrame& frame, uint64_t number) { return frame.number < number; });
    if (at != sequence.frames.end()) at->cut = true;
  }
  return absl::OkStatus();
}

absl::Status take_missing(const SequenceChoice& choice, const Found& found, Sequence& sequence) {
  if (sequence.missing.empty()) return absl::OkStatus();
  if (choice.missing == MissingFrames::kError) return missing_error(choice, found, sequence);
  const bool holds = choice.missing == MissingFrames::kHold;
  sequence.notes.push_back(absl::StrFormat("%s missing; %s", frames_are(sequence.missing),
                                           holds ? "the image of the frame before is repeated" : "skipped"));
  return holds ? hold(sequence) : absl::OkStatus();
}

}  // namespace

size_t Sequence::index_of(uint64_t session_number) const {
  const auto at =
      std::lower_bound(frames.begin(), frames.end(), session_number + zero,
                       [](const SequenceFrame& frame, uint64_t number) { return frame.number < number; });
  return static_cast<size_t>(at - frames.begin());
}

absl::StatusOr<Sequence> find_sequence(const SequenceChoice& choice) {
  const absl::StatusOr<Found> found = find(choice.inputs);
  if (!found.ok()) return found.status();
  Sequence sequence;
  sequence.names = found->names;
  sequence.zero = choice.zero.value_or(found->files.begin()->first);
  if (!found->names && found->files.size() > 1) {
    sequence.notes.push_back(absl::StrFormat(
        "these files do not look like a sequence: their names have no number in common, so they "
        "become frames 0 to %d; `candela render IN... OUTDIR/` renders each for itself",
        found->files.size() - 1));
  }
  if (absl::Status status = choose(choice, *found, sequence); !status.ok()) return status;
  if (sequence.first() < sequence.zero) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame %d comes before frame %d, with which the exposure file begins; begin there "
                        "with --range, or meter the whole shot",
                        sequence.first(), sequence.zero));
  }
  if (absl::Status status = take_missing(choice, *found, sequence); !status.ok()) return status;
  uint64_t first_chosen = sequence.first();
  if (!sequence.missing.empty()) first_chosen = std::min(first_chosen, sequence.missing.front().first);
  if (absl::Status status = mark_cuts(choice, *found, first_chosen, sequence); !status.ok()) return status;
  uint64_t place = 0;
  for (SequenceFrame& frame : sequence.frames) {
    frame.place = place;
    place += 1 + frame.holds.size();
  }
  return sequence;
}

ChosenRate choose_rate(const std::optional<FrameRate>& given, const std::optional<FrameRate>& of_file) {
  if (given) return {*given, "--fps"};
  if (of_file) return {reduced(*of_file), "file"};
  return {FrameRate{}, "default"};
}

std::string to_text(const ChosenRate& rate) {
  return absl::StrFormat("%s fps, %s", to_text(rate.rate),
                         rate.from == "--fps"       ? "from --fps"
                         : rate.from == "file"      ? "from the file"
                         : rate.from == "exposures" ? "from the exposure file"
                                                    : "the default");
}

absl::Status check_media_time(const Sequence& sequence, FrameRate rate) {
  if (sequence.media_time_ns(sequence.last(), rate) <= v1::kMediaTimeNs.max) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "frame %d is more than 146 years after frame %d at %s fps; give a higher --fps or a --range",
      sequence.last(), sequence.zero, to_text(rate)));
}

}  // namespace candela
