// What an OpenEXR header says about the colours of its values.
#pragma once

#include <OpenEXR/ImfHeader.h>

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/image/color_interop.h"
#include "client/image/image.h"

namespace candela {

struct ExrColor {
  std::optional<std::array<float, 8>> xy;  // CIE 1931 xy of red, green, blue and white; none: not named
  ColorCurve curve = ColorCurve::kLinear;
  std::vector<std::string> notes;
};

// Of several statements the first counts, in this order: acesImageContainerFlag 1 (linear AP0),
// colorInteropID, chromaticities. One note names those that contradict it. A colorInteropID of "unknown"
// states nothing; one that nobody defines states nothing and is noted. An adoptedNeutral that is not the
// white of the primaries is noted, too, and not used.
//
// Errors name `path`: UNIMPLEMENTED for the colorInteropID of a display's signal. For one of "data" the
// values are as they stand, with a note; choose_exr_picture() has decided that they are shown. With
// choice.transfer, statements count for their primaries alone, also one of a display's signal. With
// choice.own_values, nothing is an error, no primaries are named and nothing is decoded.
absl::StatusOr<ExrColor> exr_color(const std::string& path, const Imf::Header& header,
                                   const PictureChoice& choice);

// The header's colorInteropID, "" if it has none.
std::string color_interop_id(const Imf::Header& header);

// Whether the colorInteropID says that the values are no colours, and no flag says that they are.
bool holds_data(const Imf::Header& header);

bool is_aces_container(const Imf::Header& header);

// Sets the image's primaries, decodes its values, which are kRgba32f if there is a curve, and adds the notes.
void apply(const ExrColor& color, Image& image);

}  // namespace candela
