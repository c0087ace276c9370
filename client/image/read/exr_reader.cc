// OpenEXR files: chooses the picture that is shown, by the headers, reads it and describes the file.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfChromaticitiesAttribute.h>
#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfFloatAttribute.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfMultiView.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfRationalAttribute.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfRgbaYca.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfTileDescription.h>
#include <OpenEXR/ImfTiledInputPart.h>
#include <OpenEXR/ImfVecAttribute.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <iterator>
#include <limits>
#include <memory>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/algorithm/container.h"
#include "absl/status/statusor.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "client/image/color.h"
#include "client/image/image.h"
#include "client/image/kept_attributes.h"
#include "client/image/read/exr_file.h"
#include "client/image/read/file_reader.h"
#include "client/image/read/readers.h"
#include "client/image/read/signal.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr char kName[] = "framesPerSecond";
// Of the whole numbers in a rational that OpenEXR can write again.
constexpr double kMostWhole = std::numeric_limits<int>::max();

// Frames in so many seconds. Written so that NaN gives nothing.
std::optional<FrameRate> rate_from(double frames, double seconds) {
  const auto whole = [](double number) {
    return number >= 1 && number <= kMostWhole && number == std::floor(number);
  };
  if (whole(frames) && whole(seconds)) {
    return FrameRate{static_cast<uint64_t>(frames), static_cast<uint64_t>(seconds)};
  }
  if (const std::optional<FrameRate> film = film_rate(frames / seconds)) return film;
  const Imf::Rational rate(frames / seconds);
  if (rate.n <= 0 || rate.d == 0) return std::nullopt;
  return FrameRate{static_cast<uint64_t>(rate.n), rate.d};
}

std::optional<FrameRate> rate_from(absl::string_view text) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, '/');
  double frames = 0, seconds = 1;
  const bool numbers =
      parts.size() <= 2 && absl::SimpleAtod(absl::StripAsciiWhitespace(parts[0]), &frames) &&
      (parts.size() == 1 || absl::SimpleAtod(absl::StripAsciiWhitespace(parts[1]), &seconds));
  return numbers ? rate_from(frames, seconds) : std::nullopt;
}

template <typename Number>
std::optional<FrameRate> rate_from_number(const Imf::Attribute& attribute) {
  const auto* typed = dynamic_cast<const Imf::TypedAttribute<Number>*>(&attribute);
  return typed == nullptr ? std::nullopt : rate_from(static_cast<double>(typed->value()), 1);
}

template <typename Pair>
std::optional<FrameRate> rate_from_pair(const Imf::Attribute& attribute) {
  const auto* typed = dynamic_cast<const Imf::TypedAttribute<Pair>*>(&attribute);
  if (typed == nullptr) return std::nullopt;
  return rate_from(static_cast<double>(typed->value().x), static_cast<double>(typed->value().y));
}

std::optional<FrameRate> rate_from(const Imf::Attribute& attribute) {
  if (const auto* typed = dynamic_cast<const Imf::RationalAttribute*>(&attribute)) {
    return rate_from(typed->value().n, typed->value().d);
  }
  if (const auto* typed = dynamic_cast<const Imf::StringAttribute*>(&attribute)) {
    return rate_from(absl::string_view(typed->value()));
  }
  for (const auto& read :
       {rate_from_number<int>, rate_from_number<float>, rate_from_number<double>, rate_from_pair<Imath::V2i>,
        rate_from_pair<Imath::V2f>, rate_from_pair<Imath::V2d>}) {
    if (const std::optional<FrameRate> rate = read(attribute)) return rate;
  }
  return std::nullopt;
}

// The rate that the attribute framesPerSecond says, in any case. OpenEXR defines it as a rational;
// OpenImageIO also writes an integer, a float, a double, a text such as "24000/1001" or "23.976", or a pair
// of numbers, as it was given. A decimal number may stand for a film rate, as film_rate() says. If several
// attributes have the name, the one in OpenEXR's own case comes first. Nothing if none is a positive number.
std::optional<FrameRate> frame_rate_of(const Imf::Header& header) {
  if (const auto own = header.find(kName); own != header.end()) {
    if (const std::optional<FrameRate> rate = rate_from(own.attribute())) return rate;
  }
  for (auto at = header.begin(); at != header.end(); ++at) {
    if (!absl::EqualsIgnoreCase(at.name(), kName)) continue;
    if (const std::optional<FrameRate> rate = rate_from(at.attribute())) return rate;
  }
  return std::nullopt;
}

// What the names of parts and layers in OpenEXR files say about their pictures.

// How well a picture's name says that it is the one to show. The smaller, the better.
struct PictureRank {
  enum class Kind {
    kPicture,  // no name, or one of rgba, rgb, beauty, combined, C, Ci, colour, color
    kUnknown,  // any other name
    kData,     // normals, depth, occlusion, identifiers, positions, masks and their like
  };
  Kind kind = Kind::kPicture;
  int order = 0;  // among those of its kind
};

using Kind = PictureRank::Kind;

// The names of the picture itself, the surest first.
constexpr absl::string_view kPictureWords[] = {"rgba", "rgb", "beauty", "combined",
                                               "c",    "ci",  "colour", "color"};

// Words that say nothing about what a picture shows.
constexpr absl::string_view kIdleWords[] = {"main",   "pass",    "layer", "image", "output",
                                            "render", "default", "final", "left",  "right"};

constexpr absl::string_view kDataWords[] = {"alpha",        "ao",
                                            "aov",          "aovs",
                                            "confidence",   "coverage",
                                            "curvature",    "debug",
                                            "denoising",    "depth",
                                            "depthz",       "disparity",
                                            "facing",       "flow",
                                            "holdout",      "id",
                                            "ids",          "index",
                                            "mask",         "masks",
                                            "matte",        "mattes",
                                            "mist",         "motion",
                                            "motionvector", "motionvectors",
                                            "mv",           "n",
                                            "ng",           "nn",
                                            "norm",         "normal",
                                            "normals",      "nrm",
                                            "objectid",     "materialid",
                                            "occlusion",    "ambientocclusion",
                                            "opacity",      "p",
                                            "pos",          "position",
                                            "positions",    "pref",
                                            "pworld",       "samples",
                                            "shadow",       "shadows",
                                            "speed",        "st",
                                            "tangent",      "tangents",
                                            "texcoord",     "uv",
                                            "uvs",          "uvw",
                                            "variance",     "vector",
                                            "vectors",      "velocity",
                                            "wireframe",    "z",
                                            "zdepth"};

template <typename Words>
bool is_one_of(const Words& words, absl::string_view word) {
  return std::find(std::begin(words), std::end(words), word) != std::end(words);
}

bool is_data(absl::string_view word) {
  return is_one_of(kDataWords, word) || absl::StartsWith(word, "crypto");
}

// The words of a name in lower case: "RGBColor_v2" has rgb, color and v. Digits belong to no word.
std::vector<std::string> words_of(absl::string_view name) {
  std::vector<std::string> words;
  bool within = false;
  for (size_t i = 0; i < name.size(); ++i) {
    const auto at = [&](size_t k) { return k < name.size() ? static_cast<unsigned char>(name[k]) : 0; };
    const bool letter = absl::ascii_isalpha(at(i)) || at(i) >= 0x80;
    const bool upper = absl::ascii_isupper(at(i));
    const bool begins = upper && i > 0 && (absl::ascii_islower(at(i - 1)) || absl::ascii_islower(at(i + 1)));
    if (letter && (!within || begins)) words.emplace_back();
    if (letter) words.back().push_back(absl::ascii_tolower(at(i)));
    within = letter;
  }
  return words;
}

PictureRank rank_of_piece(absl::string_view piece, absl::string_view view) {
  // A name such as zDepth is also tried as one word.
  std::vector<std::string> words = words_of(piece);
  const std::string whole = absl::AsciiStrToLower(piece);
  if (is_data(whole) || std::any_of(words.begin(), words.end(), is_data)) return {Kind::kData, 0};
  std::erase_if(words, [&](const std::string& word) {
    return is_one_of(kIdleWords, word) || absl::EqualsIgnoreCase(word, view);
  });
  constexpr int kWords = static_cast<int>(std::size(kPictureWords));
  if (words.empty()) return {Kind::kUnknown, 1};
  int best = kWords;
  for (const std::string& word : words) {
    const auto* const found = std::find(std::begin(kPictureWords), std::end(kPictureWords), word);
    if (found == std::end(kPictureWords)) {
      const bool kind_of_beauty = is_one_of(words, "beauty") || is_one_of(words, "combined");
      return {Kind::kUnknown, kind_of_beauty ? 0 : 2};
    }
    best = std::min(best, static_cast<int>(found - std::begin(kPictureWords)));
  }
  return {Kind::kPicture, best + 1};
}

// The rank of the name of a part or a layer. The last of its pieces, between dots, counts. Words such as
// main, or the name of its view, change nothing. Upper and lower case are the same.
PictureRank rank_of_name(absl::string_view name, absl::string_view view) {
  std::vector<absl::string_view> pieces = absl::StrSplit(name, '.', absl::SkipEmpty());
  while (!view.empty() && !pieces.empty() && absl::EqualsIgnoreCase(pieces.back(), view)) pieces.pop_back();
  if (pieces.empty()) return {Kind::kPicture, 0};
  const PictureRank rank = rank_of_piece(pieces.back(), view);
  if (rank.kind != Kind::kUnknown) return rank;
  for (const absl::string_view piece : pieces) {
    if (rank_of_piece(piece, view).kind == Kind::kData) return {Kind::kData, 0};
  }
  return rank;
}

// The rank of a layer in a part, by the names of both. The name of a file's only part counts as none.
PictureRank rank_of_picture(absl::string_view part, absl::string_view layer, absl::string_view view) {
  const PictureRank of_part = rank_of_name(part, view), of_layer = rank_of_name(layer, view);
  if (layer.empty() || of_part.kind == Kind::kData) return of_part;
  return of_layer;
}

// What an OpenEXR header says about the colours of its values.

struct ExrColor {
  std::optional<std::array<float, 8>> xy;  // CIE 1931 xy of red, green, blue and white; none: not named
  ColorCurve curve = ColorCurve::kLinear;
  std::vector<std::string> notes;
};

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

std::string xy_text(const Xy& xy) {
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
    others.push_back(absl::StrCat(other.attribute, " (", xy_text(other.xy),
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

// The header's colorInteropID, "" if it has none.
std::string color_interop_id(const Imf::Header& header) {
  const auto* text = header.findTypedAttribute<Imf::StringAttribute>(kId);
  if (text == nullptr) return "";
  return std::string(absl::StripAsciiWhitespace(text->value()));
}

bool is_aces_container(const Imf::Header& header) {
  const auto* flag = header.findTypedAttribute<Imf::IntAttribute>(kFlag);
  return flag != nullptr && flag->value() == 1;
}

// Whether the colorInteropID says that the values are no colours, and no flag says that they are.
bool holds_data(const Imf::Header& header) {
  return absl::EqualsIgnoreCase(color_interop_id(header), "data") && !is_aces_container(header);
}

// Of several statements the first counts, in this order: acesImageContainerFlag 1 (linear AP0),
// colorInteropID, chromaticities. One note names those that contradict it. A colorInteropID of "unknown"
// states nothing; one that nobody defines states nothing and is noted. An adoptedNeutral that is not the
// white of the primaries is noted, too, and not used.
//
// Errors name `path`: UNIMPLEMENTED for the colorInteropID of a display's signal. For one of "data" the
// values are as they stand, with a note; choose_exr_picture() has decided that they are shown. With
// choice.transfer, statements count for their primaries alone, also one of a display's signal. With
// choice.own_values, nothing is an error, no primaries are named and nothing is decoded.
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

// Sets the image's primaries, decodes its values, which are kRgba32f if there is a curve, and adds the notes.
void apply(const ExrColor& color, Image& image) {
  if (color.xy) set_chromaticities(*color.xy, image);
  decode(color.curve, image);
  absl::c_copy(color.notes, std::back_inserter(image.notes));
}

// Chooses the picture of an OpenEXR file: a part, and channels in it.

// Adds a name that is not empty and not there yet.
void add_once(std::vector<std::string>& names, const std::string& name) {
  if (!name.empty() && !absl::c_linear_search(names, name)) names.push_back(name);
}

struct ExrPicture {
  int part = 0;  // counted from 0
  ExrChannels channels;
  std::vector<std::string> notes;  // what the reader chose where there is more than one picture
};

bool is_deep(const Imf::Header& header) { return header.hasType() && Imf::isDeepData(header.type()); }

// A layer of a part, and what it shows.
struct Candidate {
  int part = 0;
  ExrLayer layer;
  std::optional<ExrChannels> colour{}, data{};
  PictureRank rank{};
  bool other_view = false;  // than the file's first

  // Names after --layer that mean the plain channels of a part, which have no layer.
  bool is_rgb(const std::string& choice) const {
    return layer.name.empty() && colour && colour->kind == ExrChannels::Kind::kRgb &&
           (absl::EqualsIgnoreCase(choice, "RGB") || absl::EqualsIgnoreCase(choice, "RGBA"));
  }
  bool is_xyz(const std::string& choice) const {
    return layer.name.empty() && absl::EqualsIgnoreCase(choice, "XYZ") && has_xyz(layer);
  }
};

using Candidates = std::vector<const Candidate*>;

struct Shown {
  const Candidate* candidate;
  ExrChannels channels;

  bool operator==(const Shown& other) const {
    return candidate->part == other.candidate->part && channels == other.channels;
  }
};

std::string part_name(const Imf::Header& header) { return header.hasName() ? header.name() : ""; }

absl::Status nothing_called(const std::string& path, const char* what, const std::string& name,
                            const std::vector<std::string>& names) {
  if (names.empty()) {
    return absl::NotFoundError(absl::StrFormat("%s: there is no %s \"%s\"; the file names no %ss", path, what,
                                               shown_name(name), what));
  }
  return absl::NotFoundError(absl::StrFormat("%s: there is no %s \"%s\"; there are: %s", path, what,
                                             shown_name(name), name_list(names)));
}

// The pictures of an open file, from which one is chosen.
class Pictures {
 public:
  Pictures(const std::string& path, const Imf::MultiPartInputFile& file) : path_(path), file_(file) {
    for (int part = 0; part < file.parts(); ++part) {
      const Imf::Header& header = file.header(part);
      if (is_deep(header)) continue;
      const std::string name = file.parts() > 1 ? part_name(header) : "";
      for (ExrLayer& layer : layers_of(header)) add(part, name, std::move(layer));
    }
  }

  // The picture that a choice means, without notes.
  absl::StatusOr<Shown> find(const PictureChoice& choice) const {
    ASSIGN_OR_RETURN(const Candidates candidates, allowed_by(choice));
    auto shown = best_of(candidates, choice);
    if (!shown) return nothing_to_show(candidates, choice);
    return *std::move(shown);
  }

  std::vector<std::string> notes_on(const Shown& shown, const PictureChoice& choice) const {
    std::vector<std::string> notes;
    const Candidate& candidate = *shown.candidate;
    const std::string others = others_than(shown, choice);
    std::string words;
    if (file_.parts() > 1 && choice.part.empty() && (candidate.part > 0 || !others.empty())) {
      const std::string name = part_name(file_.header(candidate.part));
      words = absl::StrFormat("part %d of %d, %s,", candidate.part + 1, file_.parts(),
                              name.empty() ? "unnamed" : shown_name(name));
    }
    if (choice.layer.empty() && !candidate.layer.name.empty()) {
      absl::StrAppend(&words, words.empty() ? "" : " ", "layer ", shown_name(candidate.layer.name));
    }
    if (words.empty() && !others.empty()) words = "the picture without a layer";
    if (!words.empty()) notes.push_back(absl::StrCat(words, " is shown", others));
    if (shown.channels.xyz) notes.push_back("X, Y and Z are taken as CIE XYZ");
    return notes;
  }

 private:
  void add(int part, const std::string& part_name, ExrLayer layer) {
    Candidate candidate{.part = part, .layer = std::move(layer)};
    candidate.colour = colour_of(candidate.layer);
    candidate.data = data_of(candidate.layer);
    const std::string& view = candidate.layer.view;
    candidate.rank = rank_of_picture(part_name, candidate.layer.name, view);
    candidate.other_view = !all_.empty() && view != all_.front().layer.view;
    all_.push_back(std::move(candidate));
  }

  // The number of the part that --part names, from 0.
  absl::StatusOr<int> part_called(const std::string& choice) const {
    std::vector<std::string> names;
    for (int i = 0; i < file_.parts(); ++i) {
      const std::string name = part_name(file_.header(i));
      if (!name.empty() && is_called(name, choice)) return i;
      names.push_back(name.empty() ? absl::StrFormat("%d", i + 1) : absl::StrFormat("%d %s", i + 1, name));
    }
    // A list of parts shows a number and a name; both together are a choice, too.
    for (int i = 0; i < file_.parts(); ++i) {
      if (is_called(names[i], choice)) return i;
    }
    int number = 0;
    if (absl::SimpleAtoi(choice, &number) && number >= 1 && number <= file_.parts()) return number - 1;
    return nothing_called(path_, "part", choice, names);
  }

  absl::StatusOr<Candidates> allowed_by(const PictureChoice& choice) const {
    Candidates candidates;
    int part = -1;
    if (!choice.part.empty()) {
      ASSIGN_OR_RETURN(part, part_called(choice.part));
    }
    for (const Candidate& candidate : all_) {
      if (part < 0 || candidate.part == part) candidates.push_back(&candidate);
    }
    drop_data(choice, candidates);
    if (candidates.empty()) return nothing_to_show(candidates, choice);
    absl::Status status = keep_view(choice.view, candidates);
    if (status.ok()) status = keep_layer(choice.layer, candidates);
    if (!status.ok()) return status;
    return candidates;
  }

  // Drops the parts of data (holds_data()), unless the user chose a part or a layer, or wants the values as
  // they stand and there are no others.
  void drop_data(const PictureChoice& choice, Candidates& candidates) const {
    if (!choice.part.empty() || !choice.layer.empty()) return;
    Candidates colour = candidates;
    std::erase_if(colour, [&](const Candidate* c) { return holds_data(file_.header(c->part)); });
    if (!colour.empty() || !choice.own_values) candidates = std::move(colour);
  }

  absl::Status keep_view(const std::string& view, Candidates& candidates) const {
    if (view.empty()) return absl::OkStatus();
    std::vector<std::string> views;
    for (const Candidate* candidate : candidates) add_once(views, candidate->layer.view);
    std::erase_if(candidates, [&](const Candidate* c) { return !is_called(c->layer.view, view); });
    return candidates.empty() ? nothing_called(path_, "view", view, views) : absl::OkStatus();
  }

  // Keeps the candidates of a layer, or else those that have a channel of this name, or else the plain
  // channels.
  absl::Status keep_layer(const std::string& layer, Candidates& candidates) const {
    if (layer.empty()) return absl::OkStatus();
    const auto keep = [&](auto matches) {
      Candidates kept;
      for (const Candidate* candidate : candidates) {
        if (matches(*candidate)) kept.push_back(candidate);
      }
      if (kept.empty()) return false;
      candidates = std::move(kept);
      return true;
    };
    if (keep([&](const Candidate& c) {
          return is_called(c.layer.name, layer) || is_called(c.layer.prefix, layer + ".");
        }) ||
        keep([&](const Candidate& c) { return channel_called(c, layer) != nullptr; }) ||
        keep([&](const Candidate& c) { return c.is_rgb(layer) || c.is_xyz(layer); })) {
      return absl::OkStatus();
    }
    return nothing_called(path_, "layer", layer, choosable(candidates));
  }

  static const std::string* channel_called(const Candidate& candidate, const std::string& choice) {
    const auto found = absl::c_find_if(candidate.layer.channels,
                                       [&](const std::string& name) { return is_called(name, choice); });
    return found == candidate.layer.channels.end() ? nullptr : &*found;
  }

  // The candidate's single channel that the choice names, and not its layer.
  static std::optional<ExrChannels> channel_of(const Candidate& candidate, const std::string& choice) {
    if (choice.empty() || is_called(candidate.layer.name, choice) ||
        is_called(candidate.layer.prefix, choice + ".")) {
      return std::nullopt;
    }
    const std::string* name = channel_called(candidate, choice);
    if (name == nullptr) return std::nullopt;
    return ExrChannels{.kind = ExrChannels::Kind::kGrey, .prefix = candidate.layer.prefix, .red = *name};
  }

  std::optional<Shown> best_of(Candidates candidates, const PictureChoice& choice) const {
    absl::c_stable_sort(candidates, [](const Candidate* a, const Candidate* b) {
      const auto order = [](const Candidate* c) {
        return std::tuple(c->rank.kind, c->other_view, c->rank.order);
      };
      return order(a) < order(b);
    });
    for (const Candidate* candidate : candidates) {
      if (auto channel = channel_of(*candidate, choice.layer)) return Shown{candidate, *std::move(channel)};
      if (candidate->is_xyz(choice.layer)) {
        Shown shown{candidate, *candidate->data};
        shown.channels.xyz = true;
        return shown;
      }
      if (candidate->colour) return Shown{candidate, *candidate->colour};
    }
    for (const Candidate* candidate : candidates) {
      if (!candidate->data) continue;
      // Without a choice, only a single channel, and only if the part has nothing else.
      if (choice.empty() && (candidate->data->kind != ExrChannels::Kind::kGrey || !is_alone(*candidate)))
        continue;
      return Shown{candidate, *candidate->data};
    }
    return std::nullopt;
  }

  bool is_alone(const Candidate& candidate) const {
    return absl::c_none_of(all_, [&](const Candidate& c) {
      return c.part == candidate.part && &c != &candidate &&
             c.layer.channels != std::vector{c.layer.prefix + "A"};
    });
  }

  // Names for --layer that show something: layers, else their channels.
  std::vector<std::string> choosable(const Candidates& candidates) const {
    std::vector<std::string> names;
    for (const Candidate* candidate : candidates) {
      if (candidate->colour || candidate->data) add_once(names, candidate->layer.name);
    }
    for (const Candidate* candidate : candidates) {
      const bool shows = candidate->colour || candidate->data;
      if (shows && !candidate->layer.name.empty()) continue;
      if (!candidate->colour && has_xyz(candidate->layer)) add_once(names, "XYZ");
      const Imf::ChannelList& channels = file_.header(candidate->part).channels();
      for (const std::string& name : candidate->layer.channels) {
        const Imf::Channel* channel = channels.findChannel(name);
        if (channel != nullptr && channel->xSampling == 1 && channel->ySampling == 1) add_once(names, name);
      }
    }
    return names;
  }

  // "; there are also --layer AO, --part 'Noisy Image'": choices that show the other pictures. "" if there
  // are none.
  std::string others_than(const Shown& shown, const PictureChoice& choice) const {
    constexpr size_t kMost = 8;
    const absl::StatusOr<Candidates> candidates = allowed_by(choice);
    if (!candidates.ok() || channel_of(*shown.candidate, choice.layer)) return "";
    std::vector<std::string> words;
    for (const Candidate* candidate : *candidates) {
      if (candidate == shown.candidate) continue;
      if (!candidate->colour && !candidate->data) continue;
      if (words.size() == kMost) {
        words.push_back("...");
        break;
      }
      const std::string advice = advice_for(*candidate, choice);
      if (!advice.empty()) add_once(words, advice);
    }
    if (words.empty()) return "";
    return absl::StrCat(words.size() == 1 ? "; there is also " : "; there are also ",
                        absl::StrJoin(words, ", "));
  }

  // The options that show this candidate beside those that the user gave; "" if there are none.
  std::string advice_for(const Candidate& candidate, const PictureChoice& given) const {
    Shown wanted{&candidate, candidate.colour ? *candidate.colour : *candidate.data};
    wanted.channels.xyz = !candidate.colour && candidate.is_xyz("XYZ");
    const std::string part = part_name(file_.header(candidate.part)),
                      number = absl::StrCat(candidate.part + 1);
    const std::string& prefix = candidate.layer.prefix;
    std::vector<std::string> parts = {""}, layers = {""};
    if (file_.parts() > 1 && given.part.empty()) parts = {shown_name(part), number, ""};
    if (given.layer.empty()) {
      layers = {"", shown_name(candidate.layer.name), shown_name(prefix.substr(0, prefix.rfind('.')))};
      layers.push_back(wanted.channels.xyz ? "XYZ" : wanted.channels.alpha.empty() ? "RGB" : "RGBA");
      for (const std::string& channel : candidate.layer.channels) {
        if (layers.size() == 8) break;
        layers.push_back(shown_name(channel));
      }
    }
    for (const std::string& one_part : parts) {
      for (const std::string& layer : layers) {
        PictureChoice choice = given;
        if (!one_part.empty()) choice.part = one_part;
        if (!layer.empty()) choice.layer = layer;
        const absl::StatusOr<Shown> found = find(choice);
        if (found.ok() && *found == wanted) return option_words(one_part, layer);
      }
    }
    return "";
  }

  // "--part 2 --layer 'Noisy Image'"
  static std::string option_words(const std::string& part, const std::string& layer) {
    const auto option = [](const char* name, const std::string& value) {
      const bool plain = absl::c_all_of(value, [](char c) {
        return absl::ascii_isalnum(static_cast<unsigned char>(c)) || absl::StrContains("._-+:@%,/", c) ||
               (c & 0x80) != 0;
      });
      // "=" if the value could be taken for an option.
      return absl::StrCat(
          name, value[0] == '-' ? "=" : " ",
          plain ? value : absl::StrCat("'", absl::StrReplaceAll(value, {{"'", "'\\''"}}), "'"));
    };
    std::vector<std::string> words;
    if (!part.empty()) words.push_back(option("--part", part));
    if (!layer.empty()) words.push_back(option("--layer", layer));
    return absl::StrJoin(words, " ");
  }

  absl::Status nothing_to_show(const Candidates& candidates, const PictureChoice& choice) const {
    bool deep = false;
    for (int i = 0; i < file_.parts(); ++i) deep = deep || is_deep(file_.header(i));
    if (deep && (candidates.empty() || choice.empty())) {
      return absl::UnimplementedError(
          absl::StrFormat("%s: this is a deep image, which cannot be rendered; flatten it first", path_));
    }
    if (candidates.empty() && !all_.empty()) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: its colorInteropID is data, so it holds numbers and no colours; --part %d shows them as light",
          path_, all_.front().part + 1));
    }
    const std::string names = name_list(choosable(candidates));
    return absl::InvalidArgumentError(
        choice.empty()
            ? absl::StrFormat(
                  "%s: no colour channels (it has %s); it needs R G B, Y, Y RY BY or a single channel, "
                  "or name one of these with --layer",
                  path_, names)
            : absl::StrFormat("%s: nothing chosen has colour (it has %s); name one of these with --layer",
                              path_, names));
  }

  const std::string& path_;
  const Imf::MultiPartInputFile& file_;
  std::vector<Candidate> all_;
};

// Takes, of the parts, views and layers that `choice` allows and that have colour, the one whose name says
// best that it is the picture (PictureRank), and among equals the first. Without any, it takes a part
// with a single channel besides alpha, and, if the user chose a part, a view or a layer, also a vector or a
// single channel. The layer RGB or RGBA means the channels without a layer, if no layer and no channel has
// this name, and XYZ means X, Y and Z without a layer, as CIE XYZ. A note says what is shown if there is more
// to see, and the options that show the rest. NOT_FOUND for a part, layer or view that is not there, with a
// list of those that are, INVALID_ARGUMENT if there is nothing to show, and UNIMPLEMENTED for deep images.
// Errors name `path`.
absl::StatusOr<ExrPicture> choose_exr_picture(const std::string& path, const Imf::MultiPartInputFile& file,
                                              const PictureChoice& choice) {
  const Pictures pictures(path, file);
  ASSIGN_OR_RETURN(const Shown shown, pictures.find(choice));
  return ExrPicture{shown.candidate->part, shown.channels, pictures.notes_on(shown, choice)};
}

// Reads a luminance-chroma part of an OpenEXR file, with the chroma filters of OpenEXR's RGBA interface.
//
// OpenEXR's RGBA interface reads only a file's first part. A later one is copied, still compressed, into a
// file in memory. Used by one thread. Throws like OpenEXR.
class LumaChromaRows {
 public:
  // `prefix` is that of the channels' names, with its dot. The copy takes at most `max_bytes`.
  LumaChromaRows(FileReader& opened, Imf::MultiPartInputFile& file, int part, const std::string& prefix,
                 uint64_t max_bytes);
  ~LumaChromaRows();

  // Reads halves. This object must outlive it.
  ReadRows reader();

 private:
  class Copy;
  std::unique_ptr<Copy> copy_;            // null for the first part
  std::unique_ptr<Imf::IStream> stream_;  // of the file, if its first part is read
  std::unique_ptr<Imf::RgbaInputFile> input_;
};

// What decoding needs of a part's header.
Imf::Header header_of(const Imf::Header& part) {
  Imf::Header header(part.displayWindow(), part.dataWindow(), part.pixelAspectRatio(),
                     part.screenWindowCenter(), part.screenWindowWidth(), part.lineOrder(),
                     part.compression());
  header.channels() = part.channels();
  if (Imf::hasChromaticities(part)) Imf::addChromaticities(header, Imf::chromaticities(part));
  return header;
}

// Throws what RgbaInputFile's constructor would throw, which loses the open file then.
void check_weights(const Imf::Header& part) {
  if (Imf::hasChromaticities(part)) Imf::RgbaYca::computeYw(Imf::chromaticities(part));
}

// A file in memory, written once and then read.
class LumaChromaRows::Copy {
 public:
  Copy(Imf::MultiPartInputFile& file, int part, uint64_t max_bytes)
      : to_(*this), from_(*this), max_(max_bytes) {
    Imf::InputPart input(file, part);
    Imf::OutputFile output(to_, header_of(input.header()), 0);
    output.copyPixels(input);
  }
  Imf::IStream& stream() { return from_; }

 private:
  struct To : Imf::OStream {
    explicit To(Copy& file) : Imf::OStream("a part in memory"), copy(file) {}
    void write(const char* bytes, int count) override { copy.write(bytes, static_cast<uint64_t>(count)); }
    uint64_t tellp() override { return at; }
    void seekp(uint64_t position) override { at = position; }
    Copy& copy;
    uint64_t at = 0;
  };
  struct From : Imf::IStream {
    explicit From(Copy& file) : Imf::IStream("a part in memory"), copy(file) {}
    bool read(char* bytes, int count) override { return copy.read(bytes, static_cast<uint64_t>(count)); }
    uint64_t tellg() override { return at; }
    void seekg(uint64_t position) override { at = position; }
    Copy& copy;
    uint64_t at = 0;
  };

  void write(const char* bytes, uint64_t count) {
    if (count > max_ || to_.at > max_ - count) {
      throw std::runtime_error(absl::StrFormat("its luminance-chroma part takes more than %d bytes", max_));
    }
    bytes_.resize(std::max<uint64_t>(bytes_.size(), to_.at + count));
    std::memcpy(bytes_.data() + to_.at, bytes, count);
    to_.at += count;
  }

  bool read(char* bytes, uint64_t count) {
    if (from_.at > bytes_.size() || count > bytes_.size() - from_.at)
      throw std::runtime_error("the part ends");
    std::memcpy(bytes, bytes_.data() + from_.at, count);
    from_.at += count;
    return from_.at < bytes_.size();
  }

  To to_;
  From from_;
  const uint64_t max_;
  std::string bytes_;
};

LumaChromaRows::LumaChromaRows(FileReader& opened, Imf::MultiPartInputFile& file, int part,
                               const std::string& prefix, uint64_t max_bytes) {
  check_weights(file.header(part));
  const std::string layer = prefix.substr(0, prefix.empty() ? 0 : prefix.size() - 1);
  if (part == 0) {
    stream_ = stream_of(opened);
    input_ = std::make_unique<Imf::RgbaInputFile>(*stream_, layer);
  } else {
    copy_ = std::make_unique<Copy>(file, part, max_bytes);
    input_ = std::make_unique<Imf::RgbaInputFile>(copy_->stream(), layer);
  }
}

LumaChromaRows::~LumaChromaRows() = default;

ReadRows LumaChromaRows::reader() {
  return [this](char* origin, size_t row_bytes, int64_t y0, int64_t y1) {
    input_->setFrameBuffer(reinterpret_cast<Imf::Rgba*>(origin), 1, row_bytes / sizeof(Imf::Rgba));
    input_->readPixels(static_cast<int>(y0), static_cast<int>(y1));
  };
}

// Reads a part of an OpenEXR file that is unfinished or damaged: what there is of it.

struct Gaps {
  bool unfinished = false;  // chunks were never written; false: the file has all, and some cannot be decoded
  uint64_t missing = 0;     // pixels of the picture that cannot be read
  uint64_t pixels = 0;      // pixels of the picture that the part should store
};

Window overlap_of(const Window& a, const Window& b) {
  Window both = a;
  both.x0 = std::max(a.x0, b.x0), both.x1 = std::min(a.x1, b.x1);
  both.y0 = std::max(a.y0, b.y0), both.y1 = std::min(a.y1, b.y1);
  return both;
}

uint64_t pixels_in(const Window& window) {
  if (window.x1 < window.x0 || window.y1 < window.y0) return 0;
  return static_cast<uint64_t>(window.width()) * static_cast<uint64_t>(window.height());
}

class GapReader {
 public:
  GapReader(const Imf::Header& header, const ExrChannels& channels, Image* image)
      : channels_(channels),
        data_(header.dataWindow()),
        display_(header.displayWindow()),
        format_(exr_format(header, channels)),
        image_(image) {
    gaps_.pixels = pixels_in(overlap_of(data_, display_));
  }

  // Reads a chunk, which covers `box`: `read` writes it as ReadRows do.
  void read_chunk(const Window& box, const std::function<void(char* origin, size_t row_bytes)>& read) {
    const size_t pixel_bytes = bytes_per_pixel(format_);
    const size_t row_bytes = static_cast<size_t>(box.width()) * pixel_bytes;
    const size_t bytes = row_bytes * static_cast<size_t>(box.height());
    if (chunk_.size() < bytes) {
      chunk_ = PixelBuffer(bytes);
      if (chunk_.size() < bytes) throw std::bad_alloc();
    }
    const Window shown = overlap_of(box, display_);
    try {
      read(origin_of(chunk_.data(), pixel_bytes, row_bytes, box.x0, box.y0), row_bytes);
    } catch (const std::bad_alloc&) {
      throw;
    } catch (const std::exception&) {
      gaps_.missing += pixels_in(shown);
      return;
    }
    if (image_ == nullptr || pixels_in(shown) == 0) return;
    for (int64_t y = shown.y0; y <= shown.y1; ++y) {
      const std::byte* from = chunk_.data() + (y - box.y0) * row_bytes + (shown.x0 - box.x0) * pixel_bytes;
      std::byte* to = image_->pixels.data() + (y - display_.y0) * image_->row_bytes() +
                      (shown.x0 - display_.x0) * pixel_bytes;
      std::copy_n(from, static_cast<size_t>(shown.width()) * pixel_bytes, to);
      if (channels_.kind == ExrChannels::Kind::kGrey) spread_grey(format_, to, shown.width());
    }
  }

  const ExrChannels& channels() const { return channels_; }
  ImageFormat format() const { return format_; }
  const Window& data() const { return data_; }
  Gaps gaps() const { return gaps_; }

 private:
  const ExrChannels& channels_;
  const Window data_, display_;
  const ImageFormat format_;
  Image* const image_;
  PixelBuffer chunk_;
  Gaps gaps_;
};

void read_tiles(Imf::MultiPartInputFile& file, int part, GapReader& reader) {
  Imf::TiledInputPart input(file, part);
  for (int y = 0; y < input.numYTiles(); ++y) {
    for (int x = 0; x < input.numXTiles(); ++x) {
      reader.read_chunk(Window(input.dataWindowForTile(x, y)), [&](char* origin, size_t row_bytes) {
        input.setFrameBuffer(frame_of(reader.channels(), reader.format(), origin, row_bytes));
        input.readTile(x, y);
      });
    }
  }
}

void read_scan_lines(Imf::MultiPartInputFile& file, int part, GapReader& reader) {
  Imf::InputPart input(file, part);
  const Window& data = reader.data();
  const ReadRows read_rows = rows_of(input, reader.channels(), reader.format(), 0);
  const int64_t rows = rows_of_chunk(input.header().compression());
  for (int64_t y = data.y0; y <= data.y1; y += rows) {
    Window box = data;
    box.y0 = y;
    box.y1 = std::min(data.y1, y + rows - 1);
    reader.read_chunk(box,
                      [&](char* origin, size_t row_bytes) { read_rows(origin, row_bytes, box.y0, box.y1); });
  }
}

// Reads the part chunk by chunk into `image`, which has the size of the display window, is 0 everywhere, and
// keeps that where a chunk cannot be read. With `image` null it only counts. `channels` are not
// luminance-chroma. `file` has not been read from. Throws std::bad_alloc.
Gaps read_with_gaps(Imf::MultiPartInputFile& file, int part, const ExrChannels& channels, Image* image) {
  const Imf::Header& header = file.header(part);
  GapReader reader(header, channels, image);
  if (header.hasTileDescription()) {
    read_tiles(file, part, reader);
  } else {
    read_scan_lines(file, part, reader);
  }
  Gaps gaps = reader.gaps();
  gaps.unfinished = !file.partComplete(part);
  return gaps;
}

// Describes an OpenEXR file by its headers.

const char* compression_name(Imf::Compression compression) {
  constexpr const char* kNames[] = {"none",  "RLE", "ZIPS", "ZIP",  "PIZ",
                                    "PXR24", "B44", "B44A", "DWAA", "DWAB"};
  return compression >= 0 && compression < static_cast<int>(std::size(kNames)) ? kNames[compression]
                                                                               : "unknown";
}

std::string storage_of(const Imf::Header& header) {
  const bool deep = is_deep(header);
  if (!header.hasTileDescription()) return deep ? "deep scan lines" : "scan lines";
  const Imf::TileDescription& tiles = header.tileDescription();
  const char* levels = tiles.mode == Imf::MIPMAP_LEVELS ? ", mipmaps"
                       : tiles.mode == Imf::ONE_LEVEL   ? ""
                                                        : ", ripmaps";
  return absl::StrFormat("%s %dx%d%s", deep ? "deep tiles" : "tiles", tiles.xSize, tiles.ySize, levels);
}

WindowFacts window_of(const Imath::Box2i& box) { return {box.min.x, box.min.y, box.max.x, box.max.y}; }

ChannelFacts channel_of(const char* name, const Imf::Channel& channel) {
  const char* type = channel.type == Imf::HALF ? "half" : channel.type == Imf::FLOAT ? "float" : "uint";
  return {shown_name(name), type, channel.xSampling, channel.ySampling};
}

PartFacts part_of(const Imf::Header& header) {
  PartFacts part{.name = header.hasName() ? shown_name(header.name()) : "",
                 .storage = storage_of(header),
                 .compression = compression_name(header.compression()),
                 .display = window_of(header.displayWindow()),
                 .data = window_of(header.dataWindow()),
                 .pixel_aspect = header.pixelAspectRatio()};
  if (const std::optional<FrameRate> rate = frame_rate_of(header)) {
    part.frames_per_second = static_cast<double>(rate->frames) / static_cast<double>(rate->seconds);
  }
  if (const absl::StatusOr<ExrColor> color = exr_color("", header, {}); color.ok()) {
    part.chromaticities = color->xy;
  }
  part.color_interop_id = shown_name(color_interop_id(header));
  part.aces_container = is_aces_container(header);
  if (header.hasView()) add_once(part.views, shown_name(header.view()));
  if (Imf::hasMultiView(header)) {
    for (const std::string& view : Imf::multiView(header)) add_once(part.views, shown_name(view));
  }
  for (const ExrLayer& layer : layers_of(header)) add_once(part.layers, shown_name(layer.name));
  for (auto i = header.channels().begin(); i != header.channels().end(); ++i) {
    part.channels.push_back(channel_of(i.name(), i.channel()));
  }
  return part;
}

std::string shown_words(const Imf::MultiPartInputFile& file, const ExrPicture& picture) {
  const Imf::Header& header = file.header(picture.part);
  const ExrChannels& channels = picture.channels;
  std::vector<std::string> names;
  if (channels.kind == ExrChannels::Kind::kLumaChroma) {
    for (const char* name : {"Y", "RY", "BY"}) names.push_back(shown_name(channels.prefix + name));
  }
  for (const std::string& name : {channels.red, channels.green, channels.blue, channels.alpha}) {
    if (!name.empty()) names.push_back(shown_name(name));
  }
  const std::string part = file.parts() == 1
                               ? ""
                               : absl::StrFormat("part %d%s, ", picture.part + 1,
                                                 header.hasName() ? " " + shown_name(header.name()) : "");
  const char* grey = channels.kind == ExrChannels::Kind::kGrey ? " as grey" : "";
  return absl::StrCat(part, absl::StrJoin(names, " "), grey);
}

}  // namespace

absl::StatusOr<FileFacts> describe_exr(FileReader& opened, const ImageLimits& limits) {
  FileFacts facts{.kind = "OpenEXR"};
  RETURN_IF_ERROR(with_exr_file(opened, [&](Imf::MultiPartInputFile& file) {
    for (int i = 0; i < file.parts(); ++i) facts.parts.push_back(part_of(file.header(i)));
    const absl::StatusOr<ExrPicture> picture = choose_exr_picture(opened.path(), file, {});
    facts.renderable = picture.status();
    if (!picture.ok()) return absl::OkStatus();
    facts.renderable =
        check_exr_picture(opened.path(), file.header(picture->part), picture->channels, limits);
    facts.notes = picture->notes;
    if (facts.renderable.ok()) {
      const auto color = exr_color(opened.path(), file.header(picture->part), {});
      facts.renderable = color.status();
      if (color.ok()) absl::c_copy(color->notes, std::back_inserter(facts.notes));
    }
    if (facts.renderable.ok()) facts.shown = shown_words(file, *picture);
    if (!file.partComplete(picture->part)) {
      const bool luma_chroma = picture->channels.kind == ExrChannels::Kind::kLumaChroma;
      facts.notes.push_back(absl::StrCat(
          "the file is unfinished: not all of its rows or tiles were written; --incomplete fill ",
          luma_chroma ? "does not read luminance and chroma" : "renders what is there"));
    }
    return absl::OkStatus();
  }));
  return facts;
}

namespace {

// Reads OpenEXR files.
//
// Choices: the display window is the picture, and its pixels outside the data window are 0 with alpha 0. Of
// several levels the largest is used. Unsigned integers are plain values. Deep images are refused.
// choose_exr_picture() chooses the part and its channels. Luminance-chroma parts go through OpenEXR's own
// RGBA interface, which has the chroma filters and weighs Y by the part's chromaticities. If a picture cannot
// be read as a whole, it is read again in chunks, to say or to show what there is.

constexpr uint64_t kMostSideBySide = 32u << 20;  // bytes of a chunk of which several are decoded at once

void read_attributes(const Imf::Header& header, Image& image) {
  image.is_cube_map = Imf::hasEnvmap(header) && Imf::envmap(header) == Imf::ENVMAP_CUBE;
  set_pixel_aspect(header.pixelAspectRatio(), image);
  image.frame_rate = frame_rate_of(header);
}

bool covers(const Window& data, const Window& display) {
  return data.x0 <= display.x0 && data.y0 <= display.y0 && data.x1 >= display.x1 && data.y1 >= display.y1;
}

// Reads a picture of an open file. OpenEXR's exceptions are thrown on.
class PictureReader {
 public:
  PictureReader(FileReader& opened, const ImageLimits& limits, const PictureChoice& choice)
      : opened_(opened), path_(opened.path()), limits_(limits), choice_(choice) {}

  absl::StatusOr<Image> read(Imf::MultiPartInputFile& file) {
    absl::StatusOr<Image> image = begin(file);
    if (!image.ok()) return image;
    const Imf::Header& header = file.header(picture_.part);
    const int threads = chunk_bytes(header) > kMostSideBySide ? 0 : Imf::globalThreadCount();
    wants_one_thread_ = !wants_one_thread_ && threads < Imf::globalThreadCount();
    if (wants_one_thread_) return absl::CancelledError();
    at_pixels_ = true;
    const Window data(header.dataWindow()), display(header.displayWindow());
    if (is_luma_chroma()) {
      LumaChromaRows rows(opened_, file, picture_.part, picture_.channels.prefix, limits_.max_bytes);
      read_windows(data, display, false, rows.reader(), *image);
    } else {
      Imf::InputPart input(file, picture_.part);
      const bool grey = picture_.channels.kind == ExrChannels::Kind::kGrey;
      read_windows(data, display, grey, rows_of(input, picture_.channels, image->format, threads), *image);
    }
    return with_colour(*std::move(image));
  }

  // Whether the last read() did nothing, because several of the file's chunks at once would take too much
  // memory. Call it again for a file that is opened for one thread.
  bool wants_one_thread() const { return wants_one_thread_; }

  // Whether the last read() failed at the pixels, and not before.
  bool at_pixels() const { return at_pixels_; }

  // Reads what there is after read() failed at the pixels with `failure`. `file` is opened anew.
  absl::StatusOr<Image> read_incomplete(Imf::MultiPartInputFile& file, const absl::Status& failure) {
    const bool fills = choice_.fills_gaps && !is_luma_chroma();
    absl::StatusOr<Image> image = fills ? begin(file) : Image();
    if (!image.ok()) return image;
    ExrChannels channels = picture_.channels;
    if (is_luma_chroma()) channels = {.kind = ExrChannels::Kind::kGrey, .red = channels.prefix + "Y"};
    const Gaps gaps = read_with_gaps(file, picture_.part, channels, fills ? &*image : nullptr);
    if (gaps.missing == 0) {  // what is damaged is outside the picture
      if (fills) return with_colour(*std::move(image));
      return failure;
    }
    const std::string missing = absl::StrFormat("%d of its %d pixels are missing", gaps.missing, gaps.pixels);
    const std::string what =
        gaps.unfinished || absl::StrContains(failure.message(), kFileEnds)
            ? "the file is unfinished or cut off: " + missing
            : absl::StrCat(absl::StripPrefix(failure.message(), path_ + ": "), "; ", missing);
    if (gaps.missing == gaps.pixels || !fills) {
      const char* way_out = gaps.missing == gaps.pixels ? "render or copy it again"
                            : is_luma_chroma() ? "--incomplete fill does not read luminance and chroma"
                                               : "--incomplete fill renders what is there";
      return absl::InvalidArgumentError(absl::StrFormat("%s: %s; %s", path_, what, way_out));
    }
    image->notes.push_back(what + " and absent, with alpha 0");
    image->missing_pixels = gaps.missing;
    image->has_alpha = true;
    return with_colour(*std::move(image));
  }

 private:
  bool is_luma_chroma() const { return picture_.channels.kind == ExrChannels::Kind::kLumaChroma; }

  // Chooses the picture, checks the limits, and makes an image without its pixels.
  absl::StatusOr<Image> begin(const Imf::MultiPartInputFile& file) {
    ASSIGN_OR_RETURN(picture_, choose_exr_picture(path_, file, choice_));
    const ExrChannels& channels = picture_.channels;
    const Imf::Header& header = file.header(picture_.part);
    RETURN_IF_ERROR(check_exr_picture(path_, header, channels, limits_));
    const Window data(header.dataWindow()), display(header.displayWindow());
    ASSIGN_OR_RETURN(color_, exr_color(path_, header, choice_));
    if (channels.xyz && !choice_.own_values) color_.xy = kXyz.xy;
    if (wants_floats()) {
      absl::Status status =
          check_image_size(path_, "image", display.width(), display.height(), ImageFormat::kRgba32f, limits_);
      if (!status.ok()) return status;
    }
    const bool covered = covers(data, display);
    absl::StatusOr<Image> image = (covered && !choice_.fills_gaps ? image_to_overwrite : make_image)(
        static_cast<uint32_t>(display.width()), static_cast<uint32_t>(display.height()),
        exr_format(header, channels));
    if (!image.ok()) return image;
    image->has_alpha = !channels.alpha.empty() || !covered;
    read_attributes(header, *image);
    image->kept = std::make_shared<const KeptAttributes>(header);
    absl::c_move(picture_.notes, std::back_inserter(image->notes));
    return image;
  }

  bool wants_floats() const {
    return choice_.as_floats || color_.curve != ColorCurve::kLinear || decodes_values(choice_);
  }

  // The image that was read, with the colours that the file names.
  absl::StatusOr<Image> with_colour(Image read) const {
    absl::StatusOr<Image> image = wants_floats() ? to_floats(std::move(read)) : std::move(read);
    if (image.ok()) apply(color_, *image);
    return image;
  }

  FileReader& opened_;
  const std::string& path_;
  const ImageLimits& limits_;
  const PictureChoice& choice_;
  ExrPicture picture_;
  ExrColor color_;
  bool wants_one_thread_ = false;
  bool at_pixels_ = false;
};

}  // namespace

absl::StatusOr<Image> read_exr(FileReader& opened, const ImageLimits& limits, const PictureChoice& choice) {
  PictureReader reader(opened, limits, choice);
  absl::StatusOr<Image> image;
  const auto read = [&](Imf::MultiPartInputFile& file) {
    image = reader.read(file);
    return image.status();
  };
  absl::Status status = with_exr_file(opened, read);
  if (reader.wants_one_thread()) status = with_exr_file(opened, read, 0);
  if (absl::IsInvalidArgument(status) && reader.at_pixels()) {
    const absl::Status failure = status;
    const auto read_incomplete = [&](Imf::MultiPartInputFile& file) {
      image = reader.read_incomplete(file, failure);
      return image.status();
    };
    status = with_exr_file(opened, read_incomplete, 0);
  }
  if (!status.ok()) return status;
  return image;
}

}  // namespace candela
