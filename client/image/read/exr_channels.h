// Which channels of an OpenEXR part make the picture.
#pragma once

#include <OpenEXR/ImfChannelList.h>

#include <optional>
#include <string>

namespace candela {

struct ExrChannels {
  enum class Kind {
    kRgb,         // red, green, blue; a name not in the file reads as 0
    kGrey,        // red alone holds the grey
    kLumaChroma,  // Y, RY, BY of the layer
  };
  Kind kind = Kind::kRgb;
  std::string layer{};  // "" for the plain names, else "beauty"
  std::string red{}, green{}, blue{};
  std::string alpha{};  // "" when there is none
};

// The plain names (R G B, Y RY BY, Y) first, then the first layer that has them ("beauty.R"). With `lone`, as
// the last resort a channel of any name that stands alone but for alpha. Nothing: the part has no colour.
std::optional<ExrChannels> choose_exr_channels(const Imf::ChannelList& channels, bool lone);

// "R, G, B, Z", cut after a dozen, each printable().
std::string channel_names(const Imf::ChannelList& channels);

}  // namespace candela
