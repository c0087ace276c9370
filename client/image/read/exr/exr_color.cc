#include "client/image/read/exr/exr_color.h"

#include <OpenEXR/ImfChromaticitiesAttribute.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "absl/algorithm/container.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/image/primaries.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

using Xy = std::array<float, 8>;

constexpr char kId[] = "colorInteropID";
constexpr char kFlag[] = "acesImageContainerFlag";

// One of the header's statements.
struct Statement {
  std::string attribute;  // "colorInteropID lin_ap1_scene"
  Xy xy{};
  ColorCurve curve = ColorCurve::kLinear;
  bool says_curve = true;
};

Xy xy_of(absl::string_view primaries) {
  const auto known = named_primaries();
  return absl::c_find_if(known, [&](const NamedPrimaries& p) { return p.name == primaries; })->xy;
}

std::string words_of(const Xy& xy) {
  const NamedPrimaries* known = find_primaries(xy);
  return known != nullptr ? known->known_as : xy_words(xy);
}

bool agree(const Statement& a, const Statement& b) {
  const auto near = [](float x, float y) { return std::fabs(x - y) <= 5e-4f; };
  return std::equal(a.xy.begin(), a.xy.end(), b.xy.begin(), near) &&
         (!a.says_curve || !b.says_curve || a.curve == b.curve);
}

std::string contradiction(const std::vector<Statement>& statements) {
  std::vector<std::string> others;
  for (size_t i = 1; i < statements.size(); ++i) {
    const Statement& other = statements[i];
    if (agree(statements.front(), other)) continue;
    const bool encoded = other.curve != ColorCurve::kLinear;
    others.push_back(absl::StrCat(other.attribute, " (", words_of(other.xy),
                                  encoded ? absl::StrCat(", ", name(other.curve)) : "", ")"));
  }
  if (others.empty()) return "";
  return absl::StrFormat("its %s counts, against its %s", statements.front().attribute,
                         absl::StrJoin(others, " and "));
}

// The temperature of a white near the Planckian locus in kelvin, after C. S. McCamy, Color Res. Appl. 17(2),
// 1992; 0 if white balance does not reach it.
double kelvin_of(double x, double y) {
  if (!(x > 0.2 && x < 0.55 && y > 0.2 && y < 0.5)) return 0;
  const double n = (x - 0.3320) / (y - 0.1858);
  const double kelvin = ((-449.0 * n + 3525.0) * n - 6823.3) * n + 5520.33;
  return kelvin >= 2000 && kelvin <= 25000 ? kelvin : 0;
}

std::string neutral_note(const Imf::Header& header, const Xy& xy) {
  if (!Imf::hasAdoptedNeutral(header)) return "";
  const Imath::V2f& neutral = Imf::adoptedNeutral(header);
  if (std::fabs(neutral.x - xy[6]) <= 1e-3f && std::fabs(neutral.y - xy[7]) <= 1e-3f) return "";
  const double kelvin = kelvin_of(neutral.x, neutral.y);
  return absl::StrFormat("its adoptedNeutral, %.4g %.4g, is not used%s", neutral.x, neutral.y,
                         kelvin > 0 ? absl::StrFormat("; --white-balance %.0f comes close", kelvin) : "");
}

absl::Status display_error(const std::string& path, const std::string& id) {
  return absl::UnimplementedError(
      absl::StrFormat("%s: its %s is %s, the signal of a display; name its curve with "
                      "--input-transfer, such as pq, or its colour space with --ocio CONFIG --ocio-input "
                      "NAME, or say with --primaries NAME that it is linear light",
                      path, kId, printable(id)));
}

// What the ID states, if it states something.
std::optional<Statement> statement_of(const std::string& id, const PictureChoice& choice) {
  const InteropSpace* space = find_interop_space(id);
  const std::string shown = space != nullptr ? space->id : printable(id);
  if (const std::vector<std::string> words = absl::StrSplit(id, '_');
      space == nullptr && choice.transfer && is_display_interop_id(id) && words.size() > 1) {
    // "pq_rec2020_display" has the primaries of "lin_rec2020_scene".
    space = find_interop_space(absl::StrCat("lin_", words[1], "_scene"));
  }
  if (space == nullptr) return std::nullopt;
  return Statement{.attribute = absl::StrCat(kId, " ", shown),
                   .xy = xy_of(space->primaries),
                   .curve = choice.transfer ? ColorCurve::kLinear : space->curve,
                   .says_curve = !choice.transfer};
}

}  // namespace

std::string color_interop_id(const Imf::Header& header) {
  const auto* text = header.findTypedAttribute<Imf::StringAttribute>(kId);
  if (text == nullptr) return "";
  return std::string(absl::StripAsciiWhitespace(text->value()));
}

bool is_aces_container(const Imf::Header& header) {
  const auto* flag = header.findTypedAttribute<Imf::IntAttribute>(kFlag);
  return flag != nullptr && flag->value() == 1;
}

bool holds_data(const Imf::Header& header) {
  return absl::EqualsIgnoreCase(color_interop_id(header), "data") && !is_aces_container(header);
}

absl::StatusOr<ExrColor> exr_color(const std::string& path, const Imf::Header& header,
                                   const PictureChoice& choice) {
  ExrColor color;
  const std::string id = color_interop_id(header);
  const std::optional<Statement> named = statement_of(id, choice);
  const bool display = is_display_interop_id(id);
  const bool is_light = named ? named->curve == ColorCurve::kLinear : !display && !holds_data(header);
  if (choice.own_values) {
    if (!is_light && (!choice.transfer || choice.keeps_signal)) {
      color.notes.push_back(
          absl::StrFormat("its values are taken as they stand; its %s is %s", kId, printable(id)));
    }
    return color;
  }
  if (holds_data(header)) {
    color.notes.push_back(absl::StrFormat("its %s is data: its values are shown as if they were light", kId));
    return color;
  }
  std::vector<Statement> statements;
  if (is_aces_container(header)) statements.push_back({absl::StrCat(kFlag, " 1"), xy_of("AP0")});
  if (display && statements.empty() && !choice.transfer) return display_error(path, id);
  if (named) statements.push_back(*named);
  if (Imf::hasChromaticities(header)) {
    const Imf::Chromaticities& c = Imf::chromaticities(header);
    statements.push_back(
        {.attribute = "chromaticities",
         .xy = {c.red.x, c.red.y, c.green.x, c.green.y, c.blue.x, c.blue.y, c.white.x, c.white.y},
         .says_curve = false});
  }
  if (!id.empty() && !named && !absl::EqualsIgnoreCase(id, "unknown")) {
    color.notes.push_back(
        absl::StrFormat("its %s, \"%s\", is not used: %s", kId, printable(id),
                        is_aces_container(header) && (display || absl::EqualsIgnoreCase(id, "data"))
                            ? absl::StrCat("its ", kFlag, " 1 counts")
                            : "no public list has that name; --primaries says what its "
                              "primaries are"));
  }
  if (!statements.empty()) {
    color.xy = statements.front().xy;
    color.curve = statements.front().curve;
    if (std::string note = contradiction(statements); !note.empty()) color.notes.push_back(std::move(note));
    if (color.curve != ColorCurve::kLinear) {
      color.notes.push_back(absl::StrFormat("decoded from %s, as its %s says", name(color.curve),
                                            statements.front().attribute));
    }
  }
  if (std::string note = neutral_note(header, color.xy.value_or(kRec709.xy)); !note.empty()) {
    color.notes.push_back(std::move(note));
  }
  return color;
}

void apply(const ExrColor& color, Image& image) {
  if (color.xy) set_chromaticities(*color.xy, image);
  decode(color.curve, image);
  absl::c_copy(color.notes, std::back_inserter(image.notes));
}

}  // namespace candela
