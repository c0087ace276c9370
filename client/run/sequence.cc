#include "client/run/sequence.h"

#include <glob.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/algorithm/container.h"
#include "absl/status/statusor.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "client/base/failure.h"
#include "client/image/read_formats.h"
#include "client/image/write/atomic_file.h"
#include "client/run/frame_numbers.h"
#include "proto/candela/v1/limits.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

absl::Status not_one_number(const std::string& path) {
  return usage_error(absl::StrFormat(
      "%s: a pattern has one number, %%d, %%04d, #### or @@@@, in its file name, and no other %%", path));
}

// `at` is the place of the first % in the file's name.
absl::StatusOr<std::optional<NamePattern>> parse_percent(const std::string& path, size_t at) {
  size_t end = at + 1;
  while (end < path.size() && absl::ascii_isdigit(path[end])) ++end;
  int digits = 0;
  if (end > at + 1 && !absl::SimpleAtoi(path.substr(at + 1, end - at - 1), &digits)) digits = kMostDigits + 1;
  if (end >= path.size() || path[end] != 'd' || digits > kMostDigits ||
      path.find('%', end) != std::string::npos) {
    return not_one_number(path);
  }
  return NamePattern{path.substr(0, at), path.substr(end + 1), digits};
}

}  // namespace

std::string NamePattern::path(int64_t number) const {
  const int width = digits + (minus_beside && number < 0 ? 1 : 0);
  return absl::StrFormat("%s%0*d%s", before, width, number, after);
}

std::string NamePattern::text() const {
  return absl::StrFormat("%s%%%s%s", before, digits > 1 ? absl::StrFormat("0%dd", digits) : "d", after);
}

bool NamePattern::keeps_sign() const { return begins_number(before, before.size()); }

bool begins_number(const std::string& path, size_t at) {
  return at == 0 || path[at - 1] == '.' || path[at - 1] == '_' || path[at - 1] == '/';
}

absl::StatusOr<std::optional<NamePattern>> parse_name_pattern(const std::string& path) {
  const size_t name = path.rfind('/') + 1;  // 0 without a folder
  if (const size_t at = path.find('%', name); at != std::string::npos) return parse_percent(path, at);
  for (const char sign : {'#', '@'}) {
    const size_t at = path.find(sign, name);
    if (at == std::string::npos) continue;
    const size_t end = std::min(path.find_first_not_of(sign, at), path.size());
    if (path.find(sign, end) != std::string::npos || end - at > kMostDigits) return not_one_number(path);
    return NamePattern{path.substr(0, at), path.substr(end), static_cast<int>(end - at)};
  }
  return std::nullopt;
}

std::optional<int64_t> number_between(const std::string& text, size_t before, size_t after) {
  if (text.size() <= before + after) return std::nullopt;
  if (text[before] == '-' && !begins_number(text, before)) return std::nullopt;
  return parse_frame_number(absl::string_view(text).substr(before, text.size() - before - after));
}

namespace {

// The files of a sequence by the numbers in their names.

struct NumberedFiles {
  std::map<int64_t, std::string> files;  // at least one
  std::optional<NamePattern> names;      // without it the numbers count the files
  std::string left_out;                  // a note that counts files that are no frames; or ""
};

namespace fs = std::filesystem;

// A file's path without its extension, because a format may have several.
struct Stem {
  std::string folder, name;
};

// A number in a file's name: what comes before and after it.
struct Field {
  size_t before = 0, after = 0;  // characters
};

// The text around a number, with the folder.
using Around = std::tuple<absl::string_view, absl::string_view, absl::string_view>;

// The numbers in the names of files.
struct Numbering {
  std::vector<std::optional<int64_t>> numbers;  // of each file; nothing if its name does not fit
  NamePattern names;
};

// The widths of the numbers in names, which say how others would be written.
class Widths {
 public:
  void add(int64_t number, size_t width) {
    size_t& least = number < 0 ? below_0_ : others_;
    least = least == 0 ? width : std::min(least, width);
  }
  void set(NamePattern& names) const {
    // -0005 beside 0005, and not -005. Numbers without zeros, such as -5 and 5, are the same either way.
    names.minus_beside = others_ > 1 && below_0_ > others_;
    const bool one_kind = below_0_ == 0 || others_ == 0;
    names.digits = static_cast<int>(names.minus_beside ? others_
                                    : one_kind         ? below_0_ + others_
                                                       : std::min(below_0_, others_));
  }

 private:
  size_t below_0_ = 0, others_ = 0;  // 0: there are none
};

Stem stem_of(const std::string& path) {
  const fs::path normal = fs::path(path).lexically_normal();
  return {normal.parent_path().string(), normal.stem().string()};
}

// The numbers in a name, from the last one to the first.
std::vector<Field> fields_of(const std::string& name) {
  std::vector<Field> fields;
  for (size_t end = name.size(); end > 0;) {
    if (!absl::ascii_isdigit(name[end - 1])) {
      --end;
      continue;
    }
    size_t begin = end - 1;
    while (begin > 0 && absl::ascii_isdigit(name[begin - 1])) --begin;
    if (begin > 0 && name[begin - 1] == '-' && begins_number(name, begin - 1)) --begin;
    if (number_between(name, begin, name.size() - end)) fields.push_back({begin, name.size() - end});
    end = begin;
  }
  return fields;
}

Around around(const Stem& stem, Field field) {
  const absl::string_view name = stem.name;
  return {stem.folder, name.substr(0, field.before), name.substr(name.size() - field.after)};
}

// The place of a number in the first name that has it.
struct Place {
  size_t file = 0;
  Field field;
};

// The number whose surroundings most names have; of several that all of them have, the last one.
std::optional<Place> common_place(const std::vector<Stem>& stems) {
  std::map<Around, size_t> counts;
  for (const Stem& stem : stems) {
    for (const Field field : fields_of(stem.name)) ++counts[around(stem, field)];
  }
  std::optional<Place> best;
  size_t most = 0;
  bool tie = false;
  for (size_t i = 0; i < stems.size() && most < stems.size(); ++i) {
    for (const Field field : fields_of(stems[i].name)) {
      const size_t count = counts[around(stems[i], field)];
      if (count > most) {
        best = Place{i, field};
        most = count;
        tie = false;
      } else if (count == most && around(stems[i], field) != around(stems[best->file], best->field)) {
        tie = true;
      }
    }
  }
  const bool sequence = most == stems.size() || (!tie && most > 1 && 2 * most >= stems.size());
  return sequence ? best : std::nullopt;
}

std::optional<Numbering> common_numbering(const std::vector<std::string>& paths) {
  std::vector<Stem> stems;
  for (const std::string& path : paths) stems.push_back(stem_of(path));
  const std::optional<Place> place = common_place(stems);
  if (!place) return std::nullopt;
  const auto [before, after] = place->field;
  const Stem& first = stems[place->file];
  const auto [folder, head, tail] = around(first, place->field);
  const std::string& path = paths[place->file];
  const size_t name = path.size() - fs::path(path).filename().string().size();
  Numbering numbering;
  numbering.names.before = path.substr(0, name + before);
  numbering.names.after = path.substr(name + first.name.size() - after);
  Widths widths;
  for (const Stem& stem : stems) {
    const bool fits =
        stem.folder == folder && absl::StartsWith(stem.name, head) && absl::EndsWith(stem.name, tail);
    numbering.numbers.push_back(fits ? number_between(stem.name, before, after) : std::nullopt);
    if (!numbering.numbers.back()) continue;
    widths.add(*numbering.numbers.back(), stem.name.size() - before - after);
  }
  widths.set(numbering.names);
  return numbering;
}

// The numbering that the user gave by a pattern. find_frames() has found the paths by it.
Numbering numbering_by(const NamePattern& pattern, const std::vector<std::string>& paths) {
  Numbering numbering{{}, pattern};
  std::string& before = numbering.names.before;
  // A minus at the end of the pattern's own text is the sign of its numbers, as in frame.-%03d.exr.
  if (absl::EndsWith(before, "-") && begins_number(before, before.size() - 1)) before.pop_back();
  Widths widths;
  for (const std::string& path : paths) {
    const std::optional<int64_t> number = number_between(path, before.size(), pattern.after.size());
    numbering.numbers.push_back(number);
    if (number) widths.add(*number, path.size() - before.size() - pattern.after.size());
  }
  widths.set(numbering.names);
  return numbering;
}

// One note for all files that are left out.
std::string left_out_words(const LeftOut& left_out, const std::vector<std::string>& unfit,
                           const std::optional<NamePattern>& names) {
  std::vector<std::string> parts;
  if (std::string words = words_of(left_out); !words.empty()) parts.push_back(std::move(words));
  if (!unfit.empty()) {
    const bool one = unfit.size() == 1;
    parts.push_back(absl::StrFormat("%d file%s not fit %s (%s%s)", unfit.size(),
                                    one ? " whose name does" : "s whose names do", names->text(),
                                    unfit.front(), one ? "" : " ..."));
  }
  return parts.empty() ? "" : "left out: " + absl::StrJoin(parts, ", and ");
}

// Frames of one film are of one format. Others are stills beside it, or images that were made of it.
absl::Status check_one_format(const std::vector<std::string>& paths) {
  const std::string* first = nullptr;
  for (const std::string& path : paths) {
    const ReadFormat* const format = read_format_of(path);
    if (format == nullptr) continue;
    if (first == nullptr) first = &path;
    if (format == read_format_of(*first)) continue;
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s is %s and %s is %s, but a sequence is of one format; --only %s or --only %s chooses", *first,
        read_format_of(*first)->name, path, format->name, extension_of(*first).substr(1),
        extension_of(path).substr(1)));
  }
  return absl::OkStatus();
}

// Finds the files that the inputs name (see find_frames) and their numbers.
//
// A file's number is a number in its name, and the text around it is the same in all names: the folder, what
// comes before it, and what comes after it up to the extension. If several numbers fit, it is the last one.
// Names that do not fit are left out if the others are at least half of all, two at the least, and no other
// choice fits as many. Else no number counts, and the files are numbered 0, 1, 2 ... in natural order.
//
// NOT_FOUND if an input matches nothing, INVALID_ARGUMENT if two files have one number or the files are of
// two formats.
absl::StatusOr<NumberedFiles> find_numbered_files(const std::vector<std::string>& inputs,
                                                  const std::vector<std::string>& only) {
  ASSIGN_OR_RETURN(const FoundFiles found, find_frames(inputs, only));
  const std::vector<std::string>& paths = found.paths;
  RETURN_IF_ERROR(check_one_format(paths));
  std::optional<Numbering> numbering;
  if (inputs.size() == 1) {
    ASSIGN_OR_RETURN(const std::optional<NamePattern> pattern, input_pattern(inputs.front()));
    if (pattern) numbering = numbering_by(*pattern, paths);
  }
  if (!numbering) numbering = common_numbering(paths);
  NumberedFiles numbered;
  if (numbering) numbered.names = numbering->names;
  std::vector<std::string> unfit;
  for (size_t i = 0; i < paths.size(); ++i) {
    const std::optional<int64_t> number = numbering ? numbering->numbers[i] : static_cast<int64_t>(i);
    if (!number) {
      unfit.push_back(paths[i]);
      continue;
    }
    const auto [other, fresh] = numbered.files.emplace(*number, paths[i]);
    if (!fresh) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s and %s are both frame %d; give a pattern that "
                          "only one of them fits, such as in/frame.%%04d.exr",
                          other->second, paths[i], *number));
    }
  }
  numbered.left_out = left_out_words(found.left_out, unfit, numbered.names);
  return numbered;
}

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
  ASSIGN_OR_RETURN(NumberedFiles found, find_numbered_files(choice.inputs, choice.only));
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

namespace {

// False if the path cannot be examined; reading or writing it will then say why.
bool is_there_as_folder(const std::string& path) {
  std::error_code failed;
  return fs::is_directory(path, failed);
}

std::vector<std::string> files_by_glob(const std::string& pattern) {
  std::vector<std::string> files;
  glob_t found{};
  if (glob(pattern.c_str(), GLOB_NOSORT, nullptr, &found) == 0) {
    for (size_t i = 0; i < found.gl_pathc; ++i) files.emplace_back(found.gl_pathv[i]);
  }
  globfree(&found);
  std::erase_if(files, is_there_as_folder);
  return files;
}

std::string escaped_for_glob(const std::string& text) {
  return absl::StrReplaceAll(text, {{"\\", "\\\\"}, {"*", "\\*"}, {"?", "\\?"}, {"[", "\\["}});
}

std::vector<std::string> files_by_number(const NamePattern& pattern) {
  std::vector<std::string> files =
      files_by_glob(escaped_for_glob(pattern.before) + "*" + escaped_for_glob(pattern.after));
  std::erase_if(files, [&](const std::string& file) {
    const size_t around = pattern.before.size() + pattern.after.size();
    return file.size() < around + static_cast<size_t>(pattern.digits) ||
           !number_between(file, pattern.before.size(), pattern.after.size());
  });
  return files;
}

// Adds the folder's files. Hidden ones are no frames: macOS keeps a file's attributes in ._x.exr.
absl::Status add_folder(const std::string& folder, std::vector<std::string>& files, LeftOut& left_out) {
  std::error_code failed;
  for (fs::directory_iterator at(folder, failed), end; !failed && at != end; at.increment(failed)) {
    std::error_code gone;
    if (at->is_directory(gone)) continue;
    const std::string path = at->path().string();
    const bool hides = at->path().filename().string().front() == '.';
    const bool is_image = read_format_of(path) != nullptr;
    if (hides && is_image) left_out.hidden.push_back(path);
    if (!hides) files.push_back(path);
  }
  if (failed) return absl::ErrnoToStatus(failed.value(), absl::StrFormat("%s: cannot read", folder));
  return absl::OkStatus();
}

// Adds what the input is by its name: a folder's files, a file, or what a pattern matches.
absl::Status add_named(const std::string& input, std::vector<std::string>& files, LeftOut& left_out) {
  std::error_code ignored;
  if (fs::is_directory(input, ignored)) return add_folder(input, files, left_out);
  if (fs::exists(input, ignored)) {
    files.push_back(input);
    return absl::OkStatus();
  }
  const absl::StatusOr<std::optional<NamePattern>> pattern = input_pattern(input);
  if (!pattern.ok()) return pattern.status();
  files = *pattern ? files_by_number(**pattern) : files_by_glob(input);
  if (!files.empty()) return absl::OkStatus();
  return absl::NotFoundError(absl::StrFormat(
      "%s: no such file; give a folder, files, or a pattern such as 'in/*.exr' or in/%%04d.exr", input));
}

absl::Status nothing_in(const std::string& input, const std::vector<std::string>& only,
                        const LeftOut& left_out) {
  const std::string words = words_of(left_out);
  return absl::NotFoundError(absl::StrFormat(
      "%s: there is no %s file%s; name another folder, or a pattern such as 'in/*.exr'", input,
      only.empty() ? read_extensions() : absl::StrJoin(only, " or "), words.empty() ? "" : " but " + words));
}

// Adds those of one input that are taken, which may be none because of `only`.
absl::Status add_files(const std::string& input, const std::vector<std::string>& only,
                       std::vector<std::string>& taken, LeftOut& left_out) {
  std::vector<std::string> files;
  LeftOut here;
  RETURN_IF_ERROR(add_named(input, files, here));
  const bool is_folder = is_there_as_folder(input);
  const auto is_taken = [&](const std::string& file) {
    if (!only.empty()) return absl::c_linear_search(only, extension_of(file));
    return !is_folder || read_format_of(file) != nullptr;
  };
  const auto others = std::stable_partition(files.begin(), files.end(), is_taken);
  here.others.assign(others, files.end());
  files.erase(others, files.end());
  if (files.empty() && only.empty()) return nothing_in(input, only, here);
  const auto append = [](std::vector<std::string>& to, const std::vector<std::string>& from) {
    to.insert(to.end(), from.begin(), from.end());
  };
  append(taken, files);
  append(left_out.hidden, here.hidden);
  append(left_out.others, here.others);
  return absl::OkStatus();
}

// A number within a text.
struct NumberAt {
  size_t end = 0;  // where it ends; where it was to begin if there is none
  bool below_0 = false;
  absl::string_view digits;  // without zeros before them
};

NumberAt number_at(const std::string& text, size_t at) {
  const bool minus = text[at] == '-' && begins_number(text, at);
  size_t end = at + (minus ? 1 : 0);
  size_t begin = end;
  while (end < text.size() && absl::ascii_isdigit(text[end])) ++end;
  if (end == begin) return {at, false, {}};
  while (begin < end && text[begin] == '0') ++begin;
  return {end, minus && begin < end, absl::string_view(text).substr(begin, end - begin)};
}

}  // namespace

absl::StatusOr<std::optional<NamePattern>> input_pattern(const std::string& input) {
  std::error_code ignored;
  if (fs::exists(input, ignored)) return std::nullopt;
  const std::string name = fs::path(input).filename().string();
  if (!absl::StrContains(name, '%') && name.find_first_of("*?[") != std::string::npos) return std::nullopt;
  return parse_name_pattern(input);
}

bool natural_less(const std::string& a, const std::string& b) {
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    const NumberAt x = number_at(a, i), y = number_at(b, j);
    if (x.end == i || y.end == j) {
      // Any number stands where its first digit would.
      const char c = x.end == i ? a[i] : '0', d = y.end == j ? b[j] : '0';
      if (c != d) return c < d;
      ++i, ++j;
      continue;
    }
    if (x.below_0 != y.below_0) return x.below_0;
    const auto less = [](const NumberAt& n, const NumberAt& m) {
      return n.digits.size() != m.digits.size() ? n.digits.size() < m.digits.size() : n.digits < m.digits;
    };
    if (x.digits != y.digits) return x.below_0 ? less(y, x) : less(x, y);
    i = x.end, j = y.end;
  }
  if ((i == a.size()) != (j == b.size())) return i == a.size();
  return a < b;
}

std::string words_of(const LeftOut& left_out) {
  std::vector<std::string> parts;
  const auto add = [&parts](const std::vector<std::string>& files, const char* one, const char* several) {
    if (files.empty()) return;
    parts.push_back(absl::StrFormat("%d %s (%s%s)", files.size(), files.size() == 1 ? one : several,
                                    files.front(), files.size() == 1 ? "" : " ..."));
  };
  add(left_out.hidden, "hidden file", "hidden files");
  add(left_out.others, "file of another kind", "files of other kinds");
  return absl::StrJoin(parts, ", and ");
}

absl::StatusOr<FoundFiles> find_frames(const std::vector<std::string>& inputs,
                                       const std::vector<std::string>& only) {
  FoundFiles found;
  for (const std::string& input : inputs) {
    RETURN_IF_ERROR(add_files(input, only, found.paths, found.left_out));
  }
  if (found.paths.empty()) return nothing_in(inputs.front(), only, found.left_out);
  for (std::vector<std::string>* const paths :
       {&found.paths, &found.left_out.hidden, &found.left_out.others}) {
    const std::set<std::string> once(paths->begin(), paths->end());
    paths->assign(once.begin(), once.end());
    std::sort(paths->begin(), paths->end(), natural_less);
  }
  return found;
}

absl::StatusOr<OutputNames> OutputNames::parse(const std::string& output, const std::string& extension) {
  OutputNames names;
  const bool is_folder = is_there_as_folder(output) || !fs::path(output).has_extension();
  const absl::StatusOr<std::optional<NamePattern>> pattern = parse_name_pattern(output);
  if (!pattern.ok()) return pattern.status();
  // A folder may have # and @ in its name.
  if (*pattern && (!is_folder || absl::StrContains(fs::path(output).filename().string(), '%'))) {
    names.pattern_ = **pattern;
    names.extension_ = fs::path("x" + names.pattern_->after).extension().string();
    return names;
  }
  if (!is_folder) {
    return usage_error(
        absl::StrFormat("%s is a single file; give a folder or a pattern such as out/%%04d%s for a sequence",
                        output, fs::path(output).extension().string()));
  }
  names.folder_ = output;
  names.extension_ = extension;
  return names;
}

bool OutputNames::may_name(const std::string& path) const {
  if (!pattern_) return false;
  const std::string normal = fs::path(path).lexically_normal().string();
  const std::string before = fs::path(pattern_->before).lexically_normal().string();
  return absl::StartsWith(normal, before) && absl::EndsWith(normal, pattern_->after) &&
         number_between(normal, before.size(), pattern_->after.size()).has_value();
}

std::string OutputNames::path(int64_t number, const std::string& input) const {
  if (pattern_) return pattern_->path(number);
  const std::string stem = input.empty() ? absl::StrFormat("%04d", number) : fs::path(input).stem().string();
  return (fs::path(folder_) / (stem + extension_)).string();
}

}  // namespace candela
