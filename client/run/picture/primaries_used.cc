#include "client/run/picture/primaries_used.h"

#include "absl/strings/str_cat.h"
#include "client/image/primaries.h"

namespace candela {
namespace {

std::array<float, 8> xy_of(v1::Primaries primaries) {
  const char* name = primaries == v1::PRIMARIES_REC2020    ? "Rec.2020"
                     : primaries == v1::PRIMARIES_P3_D65   ? "P3-D65"
                     : primaries == v1::PRIMARIES_ACES_AP0 ? "AP0"
                     : primaries == v1::PRIMARIES_ACES_AP1 ? "AP1"
                     : primaries == v1::PRIMARIES_XYZ      ? kXyz.name
                                                           : kRec709.name;
  for (const NamedPrimaries& known : named_primaries()) {
    if (known.name == absl::string_view(name)) return known.xy;
  }
  return kRec709.xy;
}

}  // namespace

PrimariesUsed primaries_used(const Image& image, const v1::Settings& given) {
  using Source = PrimariesUsed::Source;
  if (given.has_input_chromaticities()) {
    const v1::Chromaticities& c = given.input_chromaticities();
    return {
        Source::kOption,
        {c.red_x(), c.red_y(), c.green_x(), c.green_y(), c.blue_x(), c.blue_y(), c.white_x(), c.white_y()}};
  }
  if (given.input_primaries() != v1::PRIMARIES_UNSPECIFIED) {
    return {Source::kOption, xy_of(given.input_primaries())};
  }
  return {image.names_primaries ? Source::kFile : Source::kAssumed,
          image.chromaticities.value_or(kRec709.xy)};
}

std::string words_of(const PrimariesUsed& primaries) {
  if (primaries.source == PrimariesUsed::Source::kValues) return "the file's own values";
  if (primaries.source == PrimariesUsed::Source::kView) return primaries.space + ", from --ocio-input";
  const NamedPrimaries* known = find_primaries(primaries.xy);
  const char* from = primaries.source == PrimariesUsed::Source::kFile     ? "from the file"
                     : primaries.source == PrimariesUsed::Source::kOption ? "from --primaries"
                                                                          : "assumed";
  return absl::StrCat(known != nullptr ? known->name : "primaries " + xy_words(primaries.xy), ", ", from);
}

nlohmann::ordered_json to_json(const PrimariesUsed& primaries) {
  if (primaries.source == PrimariesUsed::Source::kValues) {
    return {{"name", nullptr}, {"xy", nullptr}, {"from", "values"}};
  }
  if (primaries.source == PrimariesUsed::Source::kView) {
    return {{"name", primaries.space}, {"xy", nullptr}, {"from", "ocio-input"}};
  }
  const NamedPrimaries* known = find_primaries(primaries.xy);
  const char* from = primaries.source == PrimariesUsed::Source::kFile     ? "file"
                     : primaries.source == PrimariesUsed::Source::kOption ? "option"
                                                                          : "assumed";
  nlohmann::ordered_json name;
  if (known != nullptr) name = known->name;
  return {{"name", name}, {"xy", primaries.xy}, {"from", from}};
}

}  // namespace candela
