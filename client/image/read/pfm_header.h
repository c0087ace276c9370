// The header of a PFM or PHM file. Internal to client/image.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

struct PfmHeader {
  size_t components = 3;   // 1, 3 or 4
  bool halves = false;     // PHM
  bool top_first = false;  // the order of the rows
  bool swap = false;       // big endian
  float factor = 1;        // of the values; finite and not 0
  uint32_t width = 0, height = 0;

  // Halves stay what they are, unless they are multiplied.
  ImageFormat format() const { return halves && factor == 1 ? ImageFormat::kRgba16f : ImageFormat::kRgba32f; }
  uint64_t row_bytes() const { return uint64_t{width} * components * (halves ? 2 : 4); }
  uint64_t bytes() const { return row_bytes() * height; }
};

// The words of a header. Comments, from # to the end of the line, are skipped: the format knows none, but
// programs write them.
class PfmWords {
 public:
  // `get` takes the next byte, and returns -1 at the end.
  explicit PfmWords(absl::FunctionRef<int()> get) : get_(get) {}

  // Takes the next word and the white-space byte after it. Returns "" at the end of the file or for a word of
  // more than 32 letters.
  std::string next();

  // Takes the byte after a CR that ended the last word, where lines end in CR LF. Of a stream this is all
  // that may still belong to the header.
  void finish_line() {
    if (end_ == '\r' && crlf_) end_ = get_();
  }

 protected:
  // Returns the line end, or -1 at the end of the file.
  int after_comment();

  absl::FunctionRef<int()> get_;
  int end_ = 0;        // the byte after the last word
  bool crlf_ = false;  // a line ended in CR LF
};

// Takes the four words of the header. Errors are those of read_image(); `path` names the file.
absl::StatusOr<PfmHeader> read_pfm_header(PfmWords& words, const std::string& path, const ImageLimits& limits,
                                          RowOrder rows);

}  // namespace candela
