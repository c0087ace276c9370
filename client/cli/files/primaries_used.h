// Which primaries a frame's values are taken as, and who said so. Every result tells the user.
#pragma once

#include <array>
#include <nlohmann/json.hpp>
#include <string>

#include "candela/v1/render.pb.h"
#include "client/image/image.h"

namespace candela {

struct PrimariesUsed {
  enum class Source { kAssumed, kFile, kOption };
  Source source = Source::kAssumed;
  std::array<float, 8> xy{};  // CIE 1931 xy of red, green, blue and white
};

// `given` are the settings as the user gave them, whose primaries come before the file's.
PrimariesUsed primaries_used(const Image& image, const v1::Settings& given);

// "Rec.709, assumed"; "AP1, from the file"; "Rec.2020, from --primaries". Primaries without a name are given
// as numbers.
std::string words_of(const PrimariesUsed& primaries);

// {name (null if they have none), xy [8], from: "assumed", "file" or "option"}
nlohmann::ordered_json to_json(const PrimariesUsed& primaries);

}  // namespace candela
