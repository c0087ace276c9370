// The files of a sequence: finding the input files and naming the output files.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/run/sequence/name_pattern.h"

namespace candela {

// Natural order: compares numbers as numbers, so that frame2 comes before frame10 and frame.-2 before
// frame.-1.
bool natural_less(const std::string& a, const std::string& b);

struct FoundFiles {
  std::vector<std::string> paths;   // each file once, in natural order
  std::vector<std::string> hidden;  // image files of folders that are left out: names like .x hide them
};

// "2 hidden files (in/._a.exr ...)"; "" if there are none.
std::string words_of_hidden(const std::vector<std::string>& hidden);

// Finds the image files (.exr, .hdr, .pfm) that the inputs name. An input is a file, a folder, a pattern with
// * and ?, or a pattern with a number (see NamePattern). A file that has a pattern's own name is just that
// file. NOT_FOUND if an input matches nothing.
absl::StatusOr<FoundFiles> find_frames(const std::vector<std::string>& inputs);

// The number in an input's name. Nothing if it is a folder, a file or a pattern with * and ? instead.
absl::StatusOr<std::optional<NamePattern>> input_pattern(const std::string& input);

// Names the output files of a sequence: by number from a
// pattern, or in a folder by the name of the input file.
class OutputNames {
 public:
  // `output` is a pattern with a number in the file name (see NamePattern), or a folder. Files in a folder
  // get `extension`. A usage error for two numbers, for any other use of % and for the name of a single file.
  static absl::StatusOr<OutputNames> parse(const std::string& output, const std::string& extension);

  bool is_folder() const { return !pattern_; }
  const std::string& extension() const { return extension_; }  // including the dot

  // The path for frame `number`. A folder takes the name of `input`, or
  // the number if it is empty. A pattern ignores `input`.
  std::string path(int64_t number, const std::string& input) const;

  // Whether a number below 0 is one for those who read its name (see NamePattern). True of a folder.
  bool keeps_sign() const { return !pattern_ || pattern_->keeps_sign(); }

 private:
  std::optional<NamePattern> pattern_;
  std::string folder_;  // without a pattern
  std::string extension_;
};

}  // namespace candela
