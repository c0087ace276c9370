// What the user should know about a frame or its picture, in one sentence each; "" if there is nothing to
// say.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "candela/v1/render.pb.h"
#include "client/image/image.h"

namespace candela {

// A sentence if more than 1 % of the image's R, G and B components lie outside of the gamut of the curve,
// with what to do about it. `settings` are those that were sent.
std::optional<std::string> gamut_note(const v1::ResultHeader& result, const v1::Settings& settings);

// "exposure held at --max-exposure 64; it would have been 812", if a limit held it; else empty. Both factors
// are those of a result; a server that does not know the second leaves it 0.
std::string held_words(double target, double target_before_limits);

// Says what became of values that were no numbers or beyond 2^30; "" if there were none.
std::string bad_values_note(uint64_t nan, uint64_t infinite, uint64_t clamped);
// The same of a frame or a panorama. `counted` is the message that counts them.
template <typename Message>
std::string bad_values_note(const Message& counted) {
  return bad_values_note(counted.nan_components(), counted.infinite_components(),
                         counted.clamped_components());
}

// A note for who renders a picture that its file calls a cube map as a frame; "" if it is none.
std::string cube_map_note(const Image& image);

}  // namespace candela
