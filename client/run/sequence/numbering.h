// The files of a sequence by the numbers in their names.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/run/sequence/name_pattern.h"

namespace candela {

struct NumberedFiles {
  std::map<int64_t, std::string> files;  // at least one
  std::optional<NamePattern> names;      // without it the numbers count the files
  std::string left_out;                  // a note that counts hidden files and names that do not fit; or ""
};

// Finds the files that the inputs name (see find_frames) and their numbers.
//
// A file's number is a number in its name, and the text around it is the same in all names: the folder, what
// comes before it, and what comes after it up to the extension. If several numbers fit, it is the last one.
// Names that do not fit are left out if the others are at least half of all, two at the least, and no other
// choice fits as many. Else no number counts, and the files are numbered 0, 1, 2 ... in natural order.
//
// NOT_FOUND if an input matches nothing, INVALID_ARGUMENT if two files have one number.
absl::StatusOr<NumberedFiles> find_numbered_files(const std::vector<std::string>& inputs);

}  // namespace candela
