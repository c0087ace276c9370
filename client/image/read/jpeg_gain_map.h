// The gain map of a JPEG file: where it is, what its codes mean, and the light that it makes of the file's
// own picture. Internal to client/image.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/image/image.h"
#include "client/image/read/neighbours.h"
#include "server/encode/gain_map.h"
#include "server/encode/jpeg.h"

namespace candela {

struct FoundGainMap {
  absl::string_view jpeg{};  // within the file; empty: the file has no gain map
  GainMapMetadata metadata;  // all three channels are filled
  bool is_apple = false;     // Apple's formula, of which `metadata` has the headroom alone
  bool base_is_hdr = false;  // the file's own picture is the HDR one, and the map makes the SDR one
};

// Looks for the map where Google's Container directory and the file's MPF say, then behind the file's own
// picture. Its words are ISO 21496-1's, else Adobe's XMP, else Apple's, or those of the file's own picture.
// `segments` are those of `file`. INVALID_ARGUMENT, whose message is a reason without the file's name, if the
// file speaks of a map and has none that can be used.
absl::StatusOr<FoundGainMap> find_gain_map(absl::string_view file, const JpegSegments& segments);

// Makes HDR light of a picture's rows.
class GainMap {
 public:
  // `map` is kRgba8. The picture that it belongs to has `width` and `height`.
  GainMap(Image map, const FoundGainMap& found, bool one_channel, uint32_t width, uint32_t height);

  // Tells the image what it holds, behind what is said of the SDR picture.
  void describe(Image& image) const;

  // `light` is that of row `y` of the SDR picture, R, G, B and alpha, and becomes that of the HDR one.
  void apply(uint32_t width, uint32_t y, float* light) const;

 private:
  const uint8_t* row(uint32_t y) const {
    return reinterpret_cast<const uint8_t*>(map_.pixels.data()) + y * map_.row_bytes();
  }
  double mix(uint32_t y, const Neighbours& columns, size_t c) const;
  double gain(size_t c, double code) const;

  Image map_;
  GainMapMetadata metadata_;
  bool is_apple_;
  double peak_;
  size_t channels_;
  double scale_x_, scale_y_;
  std::array<std::array<double, 256>, 3> gains_{};
};

}  // namespace candela
