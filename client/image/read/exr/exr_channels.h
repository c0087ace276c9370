// The layers of an OpenEXR part, and the channels of a layer that make a picture.
#pragma once

#include <OpenEXR/ImfHeader.h>

#include <optional>
#include <string>
#include <vector>

namespace candela {

// The channels of a part that share a prefix: R, G, B, or beauty.R, beauty.G, beauty.B. Colours without a dot
// in their names, such as LeR, LeG, LeB, are a layer, too.
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
  bool xyz = false;     // red, green and blue are CIE X, Y and Z

  bool operator==(const ExrChannels& other) const = default;
};

// R G B or red green blue, Y RY BY, or Y; alpha is A or alpha. RY and BY are capitals, all others in any
// case; of several spellings the first of these counts, and capitals before small letters. Returns nullopt if
// the layer has no colour.
std::optional<ExrChannels> colour_of(const ExrLayer& layer);

// What to show of a layer without colour: a vector X Y Z, or any other three channels in the file's order, as
// colour; or the only channel besides alpha as grey.
std::optional<ExrChannels> data_of(const ExrLayer& layer);

// Whether the layer has X, Y and Z.
bool has_xyz(const ExrLayer& layer);

// A name as messages show it: printable(), and whole for every channel and layer.
std::string shown_name(const std::string& name);

// Whether a user who typed `choice` means `name`: as it is in the file, or as messages show it.
bool is_called(const std::string& name, const std::string& choice);

// A list such as "R, G, B, Z" of at most twelve names, each as shown_name().
std::string name_list(const std::vector<std::string>& names);

}  // namespace candela
