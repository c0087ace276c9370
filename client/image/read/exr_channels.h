// Chooses the channels of an OpenEXR part that make the picture.
#pragma once

#include <OpenEXR/ImfChannelList.h>

#include <optional>
#include <string>

namespace candela {

struct ExrChannels {
  enum class Kind {
    kRgb,         // red, green, blue; a channel that the file lacks reads as 0
    kGrey,        // `red` names the grey channel
    kLumaChroma,  // the layer's Y, RY and BY
  };
  Kind kind = Kind::kRgb;
  std::string layer{};  // such as "beauty"; "" for plain names
  std::string red{}, green{}, blue{};
  std::string alpha{};  // "" if there is none
};

// Prefers the plain names (R G B, Y RY BY, Y), then the first layer that has them, such as "beauty.R". With
// `lone` a channel of any name is the last resort if it is the only one besides alpha. Returns nullopt if the
// part has no colour.
std::optional<ExrChannels> choose_exr_channels(const Imf::ChannelList& channels, bool lone);

// A list such as "R, G, B, Z" of at most twelve names, each printable().
std::string channel_names(const Imf::ChannelList& channels);

}  // namespace candela
