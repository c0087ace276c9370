// A sheet of small pictures with words below them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

struct SheetPicture {
  Image picture;  // kRgba8; its alpha is not looked at. Without pixels: there is none
  std::string name, words;
};

// Lays the pictures, at least one, out in rows of `columns`, in cells of the largest one's size. 0: as many
// columns as rows, if the sheet may be so wide. Words that are wider than a
// cell are cut in the middle. INVALID_ARGUMENT with the sheet's size if a side would be more than
// kMaxDimension; RESOURCE_EXHAUSTED without memory.
absl::StatusOr<Image> make_contact_sheet(const std::vector<SheetPicture>& pictures, uint32_t columns);

}  // namespace candela
