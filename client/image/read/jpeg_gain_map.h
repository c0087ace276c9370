// The gain map of a JPEG file: where it is, what its codes mean, and the light that it makes of the file's
// own picture. Internal to client/image.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/image/image.h"
#include "client/image/read/neighbours.h"
#include "server/encode/gain_map.h"
#include "server/encode/jpeg.h"

namespace candela {

struct FoundGainMap {
  absl::string_view jpeg;    // within the file; empty: the file has no gain map
  GainMapMetadata metadata;  // all three channels are filled
};

// Looks for the map by MPF, then by Google's Container directory. Its metadata is ISO 21496-1, or else
// Adobe's XMP. `segments` are those of `file`. Adds a note if the file mentions a map and does not say where
// it is. INVALID_ARGUMENT, whose message does not name the file, if the place is not in the file, or the
// metadata is damaged, or makes an SDR picture of an HDR one.
absl::StatusOr<FoundGainMap> find_gain_map(absl::string_view file, const JpegSegments& segments,
                                           std::vector<std::string>& notes);

// Makes HDR light of a picture's rows.
class GainMap {
 public:
  // `map` is kRgba8. The picture that it belongs to has `width` and `height`.
  GainMap(Image map, const GainMapMetadata& metadata, bool one_channel, uint32_t width, uint32_t height);

  // Tells the image what it holds, behind what is said of the SDR picture.
  void describe(Image& image) const;

  // `codes` are R, G, B and one more of row `y`; `light` gets them with alpha 1.
  void apply(const uint8_t* codes, uint32_t width, uint32_t y, float* light) const;

 private:
  const uint8_t* row(uint32_t y) const {
    return reinterpret_cast<const uint8_t*>(map_.pixels.data()) + y * map_.row_bytes();
  }
  double mix(uint32_t y, const Neighbours& columns, size_t c) const;
  double gain(size_t c, double code) const;

  Image map_;
  GainMapMetadata metadata_;
  size_t channels_;
  double scale_x_, scale_y_;
  std::array<double, 256> sdr_{};
  std::array<std::array<double, 256>, 3> gains_{};
};

}  // namespace candela
