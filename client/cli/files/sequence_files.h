// The files of a sequence: which come in, and what those that go out are called.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace candela {

// In the order of people: runs of digits as numbers, so that frame2 comes before frame10.
bool natural_less(const std::string& a, const std::string& b);

// The image files (.exr, .hdr, .pfm) that the inputs name, in natural order, each once: files, folders,
// patterns with * and ?, and patterns with a %d or %04d. NOT_FOUND names an input that is nothing of these.
absl::StatusOr<std::vector<std::string>> find_frames(const std::vector<std::string>& inputs);

// Names for the files of a sequence: by number, after a pattern, or in a folder, after the frames they are
// of.
class OutputNames {
 public:
  // `output` has one %d (or %04d) in its name, or is a folder, whose files end in `extension`. A usage error
  // for a pattern with anything else after a %.
  static absl::StatusOr<OutputNames> parse(const std::string& output, const std::string& extension);

  bool is_folder() const { return is_folder_; }
  const std::string& extension() const { return extension_; }  // with its dot

  // Of frame number `number`, which was read from `input` (used by a folder alone; else it may be empty).
  std::string path(uint64_t number, const std::string& input) const;

  // Makes the folder that they go into, where it is missing.
  absl::Status make_folder() const;

 private:
  bool is_folder_ = false;
  std::string before_;  // of the number, or the folder
  std::string after_;
  int digits_ = 0;  // at least
  std::string extension_;
};

}  // namespace candela
