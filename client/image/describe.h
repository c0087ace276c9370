// Describes an image file without decoding its pixels.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

struct ChannelFacts {
  std::string name;
  std::string type;    // "half", "float" or "uint"
  int x_sampling = 1;  // a column of how many is stored
  int y_sampling = 1;
};

// A rectangle in the file's pixel coordinates. The last column and row are part of it.
struct WindowFacts {
  int64_t left = 0, top = 0, right = 0, bottom = 0;
};

// A part of an OpenEXR file, or a whole file of another kind. Texts of the file are printable ASCII.
struct PartFacts {
  std::string name{};         // "" if it has none
  std::string storage{};      // "scan lines", "tiles 64x64, mipmaps", "deep scan lines" ...
  std::string compression{};  // "ZIP"; "" for other kinds of files
  WindowFacts display{}, data{};
  double pixel_aspect = 1;                               // width / height of a pixel
  double frames_per_second = 0;                          // 0: the file names none
  std::optional<std::array<float, 8>> chromaticities{};  // that count, even if they are Rec.709
  std::string color_interop_id{};                        // "" if it has none
  bool aces_container = false;                           // acesImageContainerFlag is 1
  std::vector<std::string> views{};                      // the default one first
  std::vector<std::string> layers{};                     // without the one of plain names
  std::vector<ChannelFacts> channels{};
};

struct FileFacts {
  std::string kind{};              // "OpenEXR", "Radiance", "PFM"
  std::vector<PartFacts> parts{};  // one for other kinds than OpenEXR
  // What read_image() would return without a choice, or its error.
  absl::Status renderable{};
  std::string shown{};               // "part 1 rgba, R G B A"; "" if not renderable
  std::vector<std::string> notes{};  // read_image()'s notes
};

// Fails like read_image() for a file that is no image or damaged in its header. Damage in the pixels of an
// OpenEXR file is not seen; files of other kinds are read whole.
absl::StatusOr<FileFacts> describe_image(const std::string& path, const ImageLimits& limits = {});

// The same of a file that is in memory. `name` stands for its path.
absl::StatusOr<FileFacts> describe_image_bytes(const std::string& name, std::string bytes,
                                               const ImageLimits& limits = {});

}  // namespace candela
