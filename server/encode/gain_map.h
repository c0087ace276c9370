// Gain-map JPEG files: an SDR picture, and a map that makes it an HDR one.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "server/encode/picture.h"

namespace candela {

// Names of segments, each with its zero at the end.
inline constexpr absl::string_view kXmpName{"http://ns.adobe.com/xap/1.0/\0", 29};
inline constexpr absl::string_view kIsoGainMapName{"urn:iso:std:iso:ts:21496:-1\0", 28};
inline constexpr absl::string_view kMpfName{"MPF\0", 4};
// Bits in the flags of ISO 21496-1's metadata.
inline constexpr uint8_t kIsoThreeChannels = 0x80, kIsoBaseColours = 0x40;

// How the map's codes stand for gains. HDR = (SDR + offset_sdr) 2^g - offset_hdr, in linear light, where
// code / 255 = ((g - min_log2) / (max_log2 - min_log2))^gamma. Of R, G and B; with one channel, the first
// counts.
struct GainMapMetadata {
  double min_log2[3] = {0, 0, 0};
  double max_log2[3] = {0, 0, 0};
  double gamma[3] = {1, 1, 1};
  double offset_sdr[3] = {0, 0, 0};
  double offset_hdr[3] = {0, 0, 0};
  // Display headrooms, log2 of peak over white: up to the first the SDR picture is shown, from the second on
  // the HDR one.
  double headroom_base_log2 = 0;
  double headroom_hdr_log2 = 0;
  bool one_channel = true;
  bool base_primaries = true;  // the gains are of light in the base's primaries, else in the HDR picture's
};

// A map of the size of its picture: a code a pixel with one channel, else R, G and B; rows from the top.
struct GainMapCodes {
  GainMapMetadata metadata;
  std::vector<uint8_t> codes;
};

// The gain map of one channel that a server sends in place of alpha: the fourth component of each pixel is
// its code. Code 255 stands for a gain of 2^max_log2, code 0 for a gain of 1. Absent if max_log2 is 0.
std::optional<GainMapCodes> gain_map_in_alpha(const PictureView& picture, double max_log2);

// INVALID_ARGUMENT, naming the number, unless all are finite, minima are at most maxima, logarithms are
// within -64 .. 64, gammas within 0.01 .. 100, offsets within -64 .. 64, and headrooms 0 .. 64 and in order.
absl::Status check_gain_map(const GainMapMetadata& metadata);

// The map as a JPEG, 4:4:4. `codes` are as in GainMapCodes. INTERNAL with libjpeg's reason.
absl::StatusOr<std::string> encode_gain_map(std::span<const uint8_t> codes, uint32_t width, uint32_t height,
                                            bool one_channel, int quality = 95);

// One file of two finished JPEG files. The base's segments and scans stay byte for byte; what is new stands
// behind its APP0 and APP1. The metadata is in the file twice, as ISO 21496-1 and as Adobe's XMP; the map is
// found by MPF (CIPA DC-007) and by Google's Container directory. INVALID_ARGUMENT if a file is not one whole
// JPEG picture, the two are longer than 4 GiB, or check_gain_map() refuses the metadata.
absl::StatusOr<std::string> join_gain_map(absl::string_view base_jpeg, absl::string_view map_jpeg,
                                          const GainMapMetadata& metadata);

}  // namespace candela
