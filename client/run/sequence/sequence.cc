#include "client/run/sequence/sequence.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/run/sequence/numbering.h"
#include "proto/candela/v1/limits.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMostRangesSaid = 8;

// The distance of the numbers if it is the same between all files and above 1, else 1.
int64_t step_of(const std::map<int64_t, std::string>& files) {
  if (files.size() < 3) return 1;
  const int64_t step = std::next(files.begin())->first - files.begin()->first;
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

absl::Status missing_error(const SequenceChoice& choice, const Sequence& sequence) {
  const int64_t step = choice.range.empty() ? step_of(sequence.files) : 1;
  std::string hint;
  if (step > 1) {
    hint = absl::StrFormat("--range %s takes the frames in steps of %d, ",
                           to_text({{sequence.first(), sequence.last(), static_cast<uint64_t>(step)}}), step);
  } else if (choice.range.empty() && count_of(sequence.missing) > sequence.files.size()) {
    hint = "`candela render IN... OUTDIR/` renders stills each for itself, ";
  }
  return absl::NotFoundError(absl::StrFormat(
      "%s: %s missing; %s--missing skip renders the others, --missing hold repeats the frame before",
      sequence.names ? sequence.names->text() : choice.inputs.front(), frames_are(sequence.missing), hint));
}

// Whether missing numbers alone, which repeat a file before them, are a part of the sequence.
bool may_only_hold(const SequenceChoice& choice, const Sequence& sequence, int64_t first_chosen) {
  const int64_t first = sequence.files.begin()->first, last = sequence.files.rbegin()->first;
  const bool open_end = std::any_of(
      choice.range.begin(), choice.range.end(),
      [last](const NumberRange& range) { return range.last == kLargestFrameNumber && range.first > last; });
  return choice.missing == MissingFrames::kHold && first_chosen > first && !open_end;
}

// Puts the chosen frames and the missing numbers into the sequence.
absl::Status choose(const SequenceChoice& choice, Sequence& sequence) {
  const int64_t first = sequence.files.begin()->first, last = sequence.files.rbegin()->first;
  if (choice.range.empty()) {
    int64_t next = first;
    for (const auto& [number, path] : sequence.files) {
      if (number > next) sequence.missing.push_back({next, number - 1, 1});
      next = number + 1;
      sequence.frames.push_back({.number = number, .path = path});
    }
    return absl::OkStatus();
  }
  ASSIGN_OR_RETURN(const std::vector<int64_t> chosen, numbers_in(choice.range, last));
  std::vector<int64_t> missing;
  for (const int64_t number : chosen) {
    const auto at = sequence.files.find(number);
    if (at == sequence.files.end()) {
      missing.push_back(number);
    } else {
      sequence.frames.push_back({.number = number, .path = at->second});
    }
  }
  sequence.missing = ranges_of(missing);
  if (!sequence.frames.empty() || may_only_hold(choice, sequence, chosen.front())) return absl::OkStatus();
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
  if (const int64_t number = sequence.missing.front().first, first = sequence.files.begin()->first;
      number < first) {
    return absl::NotFoundError(absl::StrFormat(
        "frame %d is missing, and no frame before it can be repeated; begin --range at %d, or "
        "give --missing skip",
        number, first));
  }
  size_t at = 0;
  for (const NumberRange& range : sequence.missing) {
    for (int64_t number = range.first; number <= range.last; ++number) {
      while (at < sequence.frames.size() && sequence.frames[at].number < number) ++at;
      (at == 0 ? sequence.holds_before : sequence.frames[at - 1].holds).push_back(number);
    }
  }
  return absl::OkStatus();
}

// A scene begins at the first frame that is not before the cut's number, because that frame may be missing or
// not chosen. Cuts before the first chosen frame belong to another part of the sequence, unless that part
// ended before them.
absl::Status mark_cuts(const SequenceChoice& choice, Sequence& sequence) {
  const int64_t first = sequence.files.begin()->first, last = sequence.files.rbegin()->first;
  int64_t first_chosen = sequence.first(), last_chosen = sequence.last();
  if (!sequence.missing.empty()) {
    first_chosen = std::min(first_chosen, sequence.missing.front().first);
    last_chosen = std::max(last_chosen, sequence.missing.back().last);
  }
  for (const int64_t cut : choice.cuts) {
    // Beside an exposure file a machine may have only its own part of the files.
    if ((cut < first || cut > last) && !(choice.zero && cut >= *choice.zero)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "--cut-at %d: there is no such frame; there are frames %d to %d", cut, first, last));
    }
    if (cut < first_chosen && !(choice.after && cut > *choice.after)) continue;
    const auto at =
        std::lower_bound(sequence.frames.begin(), sequence.frames.end(), cut,
                         [](const SequenceFrame& frame, int64_t number) { return frame.number < number; });
    if (at != sequence.frames.end()) {
      at->cut = true;
    } else if (cut <= last_chosen) {
      sequence.cut_after = true;
    }
  }
  return absl::OkStatus();
}

absl::Status take_missing(const SequenceChoice& choice, Sequence& sequence) {
  if (sequence.missing.empty()) return absl::OkStatus();
  if (choice.missing == MissingFrames::kError) return missing_error(choice, sequence);
  const bool holds = choice.missing == MissingFrames::kHold;
  sequence.notes.push_back(absl::StrFormat("%s missing; %s", frames_are(sequence.missing),
                                           holds ? "the image of the frame before is repeated" : "skipped"));
  return holds ? hold(sequence) : absl::OkStatus();
}

}  // namespace

size_t Sequence::index_of(uint64_t session_number) const {
  const int64_t number = zero + static_cast<int64_t>(session_number);
  const auto at =
      std::lower_bound(frames.begin(), frames.end(), number,
                       [](const SequenceFrame& frame, int64_t sought) { return frame.number < sought; });
  return static_cast<size_t>(at - frames.begin());
}

absl::StatusOr<Sequence> find_sequence(const SequenceChoice& choice) {
  ASSIGN_OR_RETURN(NumberedFiles found, find_numbered_files(choice.inputs));
  Sequence sequence;
  sequence.names = std::move(found.names);
  sequence.files = std::move(found.files);
  sequence.zero = choice.zero.value_or(sequence.files.begin()->first);
  if (!found.left_out.empty()) sequence.notes.push_back(std::move(found.left_out));
  if (!sequence.names && sequence.files.size() > 1) {
    sequence.notes.push_back(absl::StrFormat(
        "these files do not look like a sequence: their names have no number in common, so they "
        "become frames 0 to %d; `candela render IN... OUTDIR/` renders each for itself",
        sequence.files.size() - 1));
  }
  RETURN_IF_ERROR(choose(choice, sequence));
  RETURN_IF_ERROR(take_missing(choice, sequence));
  const int64_t first = sequence.holds_before.empty() ? sequence.first() : sequence.holds_before.front();
  if (first < sequence.zero) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame %d comes before frame %d, with which the exposure file begins; begin there "
                        "with --range, or meter the whole shot",
                        first, sequence.zero));
  }
  RETURN_IF_ERROR(mark_cuts(choice, sequence));
  uint64_t place = sequence.holds_before.size();
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
