// The files of a sequence: finding the input files and naming the output files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace candela {

// Natural order: compares runs of digits as numbers, so that frame2 comes before frame10.
bool natural_less(const std::string& a, const std::string& b);

// Finds the image files (.exr, .hdr, .pfm) that the inputs name. An input is a file,
// a folder, a pattern with * and ?, or a pattern with %d or %04d. Returns each file
// once, in natural order. NOT_FOUND if an input matches nothing.
absl::StatusOr<std::vector<std::string>> find_frames(const std::vector<std::string>& inputs);

// Names the output files of a sequence: by number from a
// pattern, or in a folder by the name of the input file.
class OutputNames {
 public:
  // `output` is a pattern with one %d (or %04d) in the file name, or a folder. Files in a folder get
  // `extension`. A usage error for any other use of %.
  static absl::StatusOr<OutputNames> parse(const std::string& output, const std::string& extension);

  bool is_folder() const { return is_folder_; }
  const std::string& extension() const { return extension_; }  // including the dot

  // The path for frame `number`. A folder takes the name of `input`, or
  // the number if it is empty. A pattern ignores `input`.
  std::string path(uint64_t number, const std::string& input) const;

  // Creates the output folder if it is missing.
  absl::Status make_folder() const;

 private:
  bool is_folder_ = false;
  std::string before_;  // the text before the number, or the folder
  std::string after_;
  int digits_ = 0;  // minimum; padded with zeros
  std::string extension_;
};

}  // namespace candela
