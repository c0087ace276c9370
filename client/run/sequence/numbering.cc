#include "client/run/sequence/numbering.h"

#include <algorithm>
#include <filesystem>
#include <tuple>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"
#include "client/run/sequence/frame_numbers.h"
#include "client/run/sequence/sequence_files.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {
namespace fs = std::filesystem;

// A file's path without its extension, because files of one sequence may have several formats.
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
std::string left_out_words(const std::vector<std::string>& hidden, const std::vector<std::string>& unfit,
                           const std::optional<NamePattern>& names) {
  std::vector<std::string> parts;
  if (!hidden.empty()) parts.push_back(words_of_hidden(hidden));
  if (!unfit.empty()) {
    const bool one = unfit.size() == 1;
    parts.push_back(absl::StrFormat("%d file%s not fit %s (%s%s)", unfit.size(),
                                    one ? " whose name does" : "s whose names do", names->text(),
                                    unfit.front(), one ? "" : " ..."));
  }
  return parts.empty() ? "" : "left out: " + absl::StrJoin(parts, ", and ");
}

}  // namespace

absl::StatusOr<NumberedFiles> find_numbered_files(const std::vector<std::string>& inputs) {
  ASSIGN_OR_RETURN(const FoundFiles found, find_frames(inputs));
  const std::vector<std::string>& paths = found.paths;
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
  numbered.left_out = left_out_words(found.hidden, unfit, numbered.names);
  return numbered;
}

}  // namespace candela
