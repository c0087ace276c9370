// The gain map between an SDR picture and an HDR picture of the same frame (docs/pipeline.md section 5).
#pragma once

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/image/image.h"
#include "server/encode/gain_map.h"

namespace candela {

// The HDR displays for which ACES 2.0 is published, and its light of a grey of 0.18 there, in nit.
struct Aces2Grey {
  double peak_nits, nits;
};
inline constexpr Aces2Grey kAces2Greys[] = {
    {500, 13.192876}, {1000, 14.511552}, {2000, 15.746733}, {4000, 16.824208}};

// The settings of the HDR picture beside an SDR one: `curve` is BT2390 or ACES_2, on a display of this peak
// in P3-D65, in PQ. The frame must have the SDR picture's exposure.
v1::Settings hdr_settings(v1::Settings sdr, v1::ToneCurve curve, double peak_nits);

// The map of three channels. `sdr` is kRgba8 in sRGB and `hdr`, of the same size, is the picture of
// hdr_settings(), kRgba16. Its light is in units of the base's white: 203 nit, or with ACES_2 so that a grey
// of 0.18 is as bright as in ACES 2.0's SDR picture. Light outside of Rec.709 is cut. The same bits on every
// processor. RESOURCE_EXHAUSTED if there is not enough memory.
absl::StatusOr<GainMapCodes> gain_map_between(const Image& sdr, const Image& hdr, v1::ToneCurve curve,
                                              double peak_nits);

}  // namespace candela
