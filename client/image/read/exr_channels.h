// The layers of an OpenEXR part, and the channels of a layer that make a picture.
#pragma once

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfHeader.h>

#include <optional>
#include <string>
#include <vector>

namespace candela {

// The channels of a part that share a prefix: R, G, B, or beauty.R, beauty.G, beauty.B.
struct ExrLayer {
  std::string view{};                   // "" if the part names none
  std::string name{};                   // the prefix without the view and the last dot; "" for plain names
  std::string prefix{};                 // such as "beauty.left."
  std::vector<std::string> channels{};  // full names
};

// The default view's layers first, and in each view the one with plain names first.
std::vector<ExrLayer> layers_of(const Imf::Header& header);

struct ExrChannels {
  enum class Kind {
    kRgb,         // red, green, blue; a channel that the file lacks reads as 0
    kGrey,        // `red` names the grey channel
    kLumaChroma,  // the prefix' Y, RY and BY
  };
  Kind kind = Kind::kRgb;
  std::string prefix{};
  std::string red{}, green{}, blue{};
  std::string alpha{};  // "" if there is none
};

// R G B, Y RY BY, or Y; alpha is A. Returns nullopt if the layer has no colour.
std::optional<ExrChannels> colour_of(const Imf::ChannelList& channels, const ExrLayer& layer);

// What to show of a layer without colour: a vector X Y Z as colour, or the only channel besides alpha as
// grey.
std::optional<ExrChannels> data_of(const Imf::ChannelList& channels, const ExrLayer& layer);

// A list such as "R, G, B, Z" of at most twelve names, each printable().
std::string name_list(const std::vector<std::string>& names);
std::string channel_names(const Imf::ChannelList& channels);

}  // namespace candela
