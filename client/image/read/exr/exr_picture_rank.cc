#include "client/image/read/exr/exr_picture_rank.h"

#include <algorithm>
#include <iterator>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_split.h"

namespace candela {
namespace {

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

}  // namespace

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

PictureRank rank_of_picture(absl::string_view part, absl::string_view layer, absl::string_view view) {
  const PictureRank of_part = rank_of_name(part, view), of_layer = rank_of_name(layer, view);
  if (layer.empty() || of_part.kind == Kind::kData) return of_part;
  return of_layer;
}

}  // namespace candela
