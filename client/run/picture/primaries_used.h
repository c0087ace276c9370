// Which primaries a frame's values are taken as, and who said so. Every result tells the user.
#pragma once

#include <array>
#include <nlohmann/json.hpp>
#include <string>

#include "candela/v1/render.pb.h"
#include "client/image/image.h"

namespace candela {

struct PrimariesUsed {
  enum class Source {
    kAssumed,
    kFile,
    kOption,  // --primaries
    kView,    // --ocio-input names a colour space
    kValues   // none are used: a view of data shows the file's values
  };
  Source source = Source::kAssumed;
  std::array<float, 8> xy{};  // CIE 1931 xy of red, green, blue and white; of kView and kValues not used
  std::string space{};        // of kView
};

// `given` are the settings as the user gave them, whose primaries come before the file's.
PrimariesUsed primaries_used(const Image& image, const v1::Settings& given);

// "Rec.709, assumed"; "AP1, from the file"; "Rec.2020, from --primaries"; "ACEScct, from --ocio-input"; "the
// file's own values". Primaries without a name are given as numbers.
std::string words_of(const PrimariesUsed& primaries);

// {name (null if they have none), xy [8] (null if they are not used), from: "assumed", "file", "option",
// "ocio-input" or "values"}
nlohmann::ordered_json to_json(const PrimariesUsed& primaries);

}  // namespace candela
