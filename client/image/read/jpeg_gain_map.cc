#include "client/image/read/jpeg_gain_map.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/number_words.h"
#include "client/image/power.h"
#include "client/image/read/exif.h"
#include "client/image/read/xmp.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Sources: see server/encode/gain_map.cc. The flags 4 and 8 of ISO 21496-1's byte are those that
// google/libultrahdr writes: the base is the HDR picture, and all fractions share a denominator.

// Checks the metadata, and fills the channels that it leaves out.
absl::Status fill_channels(GainMapMetadata& metadata) {
  RETURN_IF_ERROR(check_gain_map(metadata));
  for (int c = 1; metadata.one_channel && c < 3; ++c) {
    for (auto member : {&GainMapMetadata::min_log2, &GainMapMetadata::max_log2, &GainMapMetadata::gamma,
                        &GainMapMetadata::offset_sdr, &GainMapMetadata::offset_hdr}) {
      (metadata.*member)[c] = (metadata.*member)[0];
    }
  }
  return absl::OkStatus();
}

// ---- ISO 21496-1 ----

class IsoNumbers {
 public:
  explicit IsoNumbers(absl::string_view bytes) : bytes_(bytes) {}

  // 0 if the bytes end before it; then is_whole() is false.
  uint32_t next(size_t size) {
    is_whole_ = is_whole_ && bytes_.size() >= size;
    if (!is_whole_) return 0;
    uint32_t v = 0;
    for (size_t i = 0; i < size; ++i) v = v << 8 | static_cast<uint8_t>(bytes_[i]);
    bytes_.remove_prefix(size);
    return v;
  }
  // Makes 1 / `denominator` the unit of all fractions that follow, which are numerators then.
  void share(uint32_t denominator) {
    shares_ = true;
    shared_ = denominator;
  }
  double fraction() {
    const uint32_t v = next(4);
    return over_denominator(v);
  }
  double signed_fraction() {
    const auto v = static_cast<int32_t>(next(4));
    return over_denominator(v);
  }
  bool is_whole() const { return is_whole_; }

 private:
  // Not a number for a denominator of 0, which check_gain_map() refuses.
  double over_denominator(double numerator) {
    const uint32_t denominator = shares_ ? shared_ : next(4);
    return denominator == 0 ? std::numeric_limits<double>::quiet_NaN() : numerator / denominator;
  }

  absl::string_view bytes_;
  bool shares_ = false;
  uint32_t shared_ = 0;
  bool is_whole_ = true;
};

constexpr uint8_t kIsoBaseIsHdr = 4, kIsoShared = 8;

// The picture that a map belongs to has the versions alone.
absl::StatusOr<std::optional<FoundGainMap>> words_of_iso(absl::string_view body) {
  if (body.size() <= 4) return std::nullopt;
  IsoNumbers numbers(body);
  const uint32_t least_version = numbers.next(2);
  numbers.next(2);  // the writer's version
  if (least_version != 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("it needs version %d of ISO 21496-1; Candela reads version 0", least_version));
  }
  const uint32_t flags = numbers.next(1);
  if ((flags & kIsoShared) != 0) numbers.share(numbers.next(4));
  GainMapMetadata metadata;
  metadata.one_channel = (flags & kIsoThreeChannels) == 0;
  metadata.base_primaries = (flags & kIsoBaseColours) != 0;
  metadata.headroom_base_log2 = numbers.fraction();
  metadata.headroom_hdr_log2 = numbers.fraction();
  for (int c = 0; c < (metadata.one_channel ? 1 : 3); ++c) {
    metadata.min_log2[c] = numbers.signed_fraction();
    metadata.max_log2[c] = numbers.signed_fraction();
    metadata.gamma[c] = numbers.fraction();
    metadata.offset_sdr[c] = numbers.signed_fraction();
    metadata.offset_hdr[c] = numbers.signed_fraction();
  }
  if (!numbers.is_whole()) return absl::InvalidArgumentError("its ISO 21496-1 metadata ends too early");
  const bool falls = metadata.headroom_base_log2 > metadata.headroom_hdr_log2;
  if (falls) std::swap(metadata.headroom_base_log2, metadata.headroom_hdr_log2);
  return FoundGainMap{.metadata = metadata, .base_is_hdr = falls || (flags & kIsoBaseIsHdr) != 0};
}

// ---- Adobe's XMP ----

using Xmp = std::vector<XmpProperty>;

std::vector<std::string> values_of(const Xmp& xmp, XmpSpace space, absl::string_view name) {
  std::vector<std::string> values;
  for (const XmpProperty& one : xmp) {
    if (one.space == space && one.name == name) values.push_back(one.value);
  }
  return values;
}

bool names(const Xmp& xmp, XmpSpace space, absl::string_view name) {
  return !values_of(xmp, space, name).empty();
}

// One number, or three, to `values`. They stay as they are if the name is not there.
absl::Status take_numbers(const Xmp& xmp, absl::string_view name, bool& one_channel, double (&values)[3]) {
  const std::vector<std::string> words = values_of(xmp, XmpSpace::kGainMap, name);
  if (words.empty()) return absl::OkStatus();
  bool good = words.size() == 1 || words.size() == 3;
  for (size_t i = 0; good && i < 3; ++i) good = absl::SimpleAtod(words[i % words.size()], &values[i]);
  if (!good) return absl::InvalidArgumentError(absl::StrCat("its hdrgm:", name, " is not 1 or 3 numbers"));
  if (words.size() == 3) one_channel = false;
  return absl::OkStatus();
}

// The picture that a map belongs to has the version alone.
absl::StatusOr<std::optional<FoundGainMap>> words_of_adobe(const Xmp& xmp) {
  if (!names(xmp, XmpSpace::kGainMap, "GainMapMax") && !names(xmp, XmpSpace::kGainMap, "HDRCapacityMax")) {
    return std::nullopt;
  }
  for (const char* name : {"GainMapMax", "HDRCapacityMax"}) {
    if (names(xmp, XmpSpace::kGainMap, name)) continue;
    return absl::InvalidArgumentError(absl::StrCat("it has no hdrgm:", name));
  }
  // The values where the file leaves a name out.
  GainMapMetadata metadata{.offset_sdr = {1 / 64.0, 1 / 64.0, 1 / 64.0},
                           .offset_hdr = {1 / 64.0, 1 / 64.0, 1 / 64.0}};
  bool one_headroom = true;
  double base[3] = {0, 0, 0}, hdr[3] = {0, 0, 0};
  RETURN_IF_ERROR(take_numbers(xmp, "GainMapMin", metadata.one_channel, metadata.min_log2));
  RETURN_IF_ERROR(take_numbers(xmp, "GainMapMax", metadata.one_channel, metadata.max_log2));
  RETURN_IF_ERROR(take_numbers(xmp, "Gamma", metadata.one_channel, metadata.gamma));
  RETURN_IF_ERROR(take_numbers(xmp, "OffsetSDR", metadata.one_channel, metadata.offset_sdr));
  RETURN_IF_ERROR(take_numbers(xmp, "OffsetHDR", metadata.one_channel, metadata.offset_hdr));
  RETURN_IF_ERROR(take_numbers(xmp, "HDRCapacityMin", one_headroom, base));
  RETURN_IF_ERROR(take_numbers(xmp, "HDRCapacityMax", one_headroom, hdr));
  metadata.headroom_base_log2 = base[0];
  metadata.headroom_hdr_log2 = hdr[0];
  const std::vector<std::string> is_hdr = values_of(xmp, XmpSpace::kGainMap, "BaseRenditionIsHDR");
  return FoundGainMap{.metadata = metadata,
                      .base_is_hdr = !is_hdr.empty() && absl::EqualsIgnoreCase(is_hdr.front(), "true")};
}

// ---- Apple ----

// Source: Apple, "Applying Apple HDR effect to your photos", developer.apple.com. The numbers are those of
// the iPhone's maker note, tags 33 and 48.
double apple_stops(double of_33, double of_48) {
  const bool small = of_48 <= 0.01;
  const double stops = of_33 < 1 ? (small ? -20 * of_48 + 1.8 : -0.101 * of_48 + 1.601)
                                 : (small ? -70 * of_48 + 3 : -0.303 * of_48 + 2.303);
  return std::max(stops, 0.0);
}

// log2 of peak over white, by the map's XMP, or by the picture's Exif. Not a number if neither says it.
double apple_headroom_log2(const Xmp& xmp, absl::string_view exif) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::string> words = values_of(xmp, XmpSpace::kAppleGainMap, "HDRGainMapHeadroom");
  if (double headroom = 0; !words.empty()) {
    const bool good = absl::SimpleAtod(words.front(), &headroom) && headroom >= 1 && std::isfinite(headroom);
    return good ? log2_of(headroom) : kNone;
  }
  const std::optional<double> of_33 = apple_number(exif, 33), of_48 = apple_number(exif, 48);
  return of_33 && of_48 ? apple_stops(*of_33, *of_48) : kNone;
}

absl::StatusOr<std::optional<FoundGainMap>> words_of_apple(const Xmp& xmp, absl::string_view exif) {
  if (!names(xmp, XmpSpace::kAppleGainMap, "HDRGainMapVersion")) return std::nullopt;
  const double stops = apple_headroom_log2(xmp, exif);
  if (std::isnan(stops)) {
    return absl::InvalidArgumentError(
        "Apple's kind of map needs a headroom, and neither its HDRGainMapHeadroom nor an iPhone's maker "
        "note in the file's Exif says one");
  }
  return FoundGainMap{.metadata = {.headroom_hdr_log2 = stops}, .is_apple = true};
}

// The words of a picture. Absent if it says nothing of a gain map. `exif` is that of the file's own picture.
absl::StatusOr<std::optional<FoundGainMap>> map_words_of(const JpegSegments& map, absl::string_view exif) {
  const Xmp xmp = xmp_properties(map.named(kApp1, kXmpName).value_or(""));
  absl::Status unusable;
  for (absl::StatusOr<std::optional<FoundGainMap>> words :
       {words_of_iso(map.named(kApp2, kIsoGainMapName).value_or("")), words_of_adobe(xmp),
        words_of_apple(xmp, exif)}) {
    absl::Status status = words.status();
    if (status.ok() && *words) status = fill_channels((*words)->metadata);
    if (status.ok() && *words) return words;
    unusable.Update(status);
  }
  RETURN_IF_ERROR(unusable);
  return std::nullopt;
}

// ---- Where the map is ----

constexpr size_t kMostPlaces = 16;  // each may be as long as the file

void add_places_of_mpf(absl::string_view file, const JpegSegments& segments, std::vector<uint64_t>& places) {
  constexpr uint32_t kEntries = 0xb002, kEntryBytes = 16;
  const std::optional<absl::string_view> body = segments.named(kApp2, kMpfName);
  if (!body) return;
  const uint64_t order_at = static_cast<uint64_t>(body->data() - file.data());
  const TiffBytes mpf(*body);
  const std::optional<TiffBytes::Tag> tag = mpf.tag(kEntries);
  if (!tag || tag->count < 2 * kEntryBytes) return;
  const size_t first = mpf.number_32(tag->value_at).value_or(0);
  for (uint32_t i = 1; i < tag->count / kEntryBytes && places.size() < kMostPlaces; ++i) {
    const std::optional<uint32_t> offset = mpf.number_32(first + size_t{kEntryBytes} * i + 8);
    if (!offset) break;
    if (*offset > 0) places.push_back(order_at + *offset);
  }
}

// By Google's Container directory: the files follow each other in its order, behind the first one and its
// padding.
void add_places_of_directory(const Xmp& xmp, const JpegSegments& segments, std::vector<uint64_t>& places) {
  if (segments.end == 0) return;
  uint64_t from = segments.end;
  bool is_first = true;
  for (size_t i = 0; i < xmp.size() && places.size() < kMostPlaces;) {
    uint32_t length = 0, padding = 0;
    bool is_item = false;
    for (const int item = xmp[i].item; i < xmp.size() && xmp[i].item == item; ++i) {
      if (xmp[i].space != XmpSpace::kContainerItem) continue;
      is_item = true;
      if (xmp[i].name == "Length") (void)absl::SimpleAtoi(xmp[i].value, &length);
      if (xmp[i].name == "Padding") (void)absl::SimpleAtoi(xmp[i].value, &padding);
      if (xmp[i].name == "Semantic" && xmp[i].value == "GainMap") places.push_back(from);
    }
    if (!is_item) continue;
    from += (is_first ? 0 : uint64_t{length}) + padding;  // the first one's end is known
    is_first = false;
  }
}

// ---- The light ----

// Light of a signal, by the inverse of ITU-R BT.709's curve.
double rec709_light(double signal) {
  return signal < 0.081 ? signal / 4.5 : power((signal + 0.099) / 1.099, 1 / 0.45);
}

// Those in the map of a place in the picture.
Neighbours neighbours_in(uint32_t at, double scale, uint32_t count) {
  return neighbours_of((at + 0.5) * scale - 0.5, count);
}

}  // namespace

absl::StatusOr<FoundGainMap> find_gain_map(absl::string_view file, const JpegSegments& segments) {
  const absl::string_view exif = segments.named(kApp1, kExifName).value_or("");
  const Xmp xmp = xmp_properties(segments.named(kApp1, kXmpName).value_or(""));
  std::vector<uint64_t> places;
  add_places_of_directory(xmp, segments, places);
  add_places_of_mpf(file, segments, places);

  bool is_named = names(xmp, XmpSpace::kGainMap, "Version") || segments.named(kApp2, kIsoGainMapName);
  absl::Status unusable;
  absl::string_view wordless;  // the picture at the first place, if it says nothing of a gain map
  // Goes on behind the picture at a place, if one is there.
  const auto look = [&](uint64_t at, uint64_t& next) -> std::optional<FoundGainMap> {
    next = at + 1;
    const absl::string_view jpeg = file.substr(std::min<uint64_t>(at, file.size()));
    const absl::StatusOr<JpegSegments> found = jpeg_segments(jpeg);
    if (!found.ok()) return std::nullopt;
    if (found->end > 0) next = at + found->end;
    absl::StatusOr<std::optional<FoundGainMap>> words = map_words_of(*found, exif);
    is_named = is_named || !words.ok();
    unusable.Update(words.status());
    const absl::string_view whole = jpeg.substr(0, found->end > 0 ? found->end : jpeg.size());
    if (words.ok() && *words) (*words)->jpeg = whole;
    if (words.ok() && !*words && !places.empty() && at == places.front()) wordless = whole;
    return words.value_or(std::nullopt);
  };
  uint64_t next = 0;
  for (const uint64_t at : places) {
    if (const std::optional<FoundGainMap> found = look(at, next)) return *found;
  }
  // An editor may have moved the map, or left what says its place behind.
  uint64_t at = segments.end;
  for (size_t i = 0; at > 0 && i < kMostPlaces && (at = file.find("\xff\xd8\xff", at)) != file.npos; ++i) {
    if (const std::optional<FoundGainMap> found = look(at, at)) return *found;
  }
  if (!is_named) return FoundGainMap{};  // others, such as small previews, are not used
  RETURN_IF_ERROR(unusable);
  // The words may stand in the file's own picture alone.
  ASSIGN_OR_RETURN(std::optional<FoundGainMap> own, map_words_of(segments, exif));
  if (!own || wordless.empty()) return absl::InvalidArgumentError("the file speaks of one, and holds none");
  own->jpeg = wordless;
  return *own;
}

GainMap::GainMap(Image map, const FoundGainMap& found, bool one_channel, uint32_t width, uint32_t height)
    : map_(std::move(map)),
      metadata_(found.metadata),
      is_apple_(found.is_apple),
      peak_(exponential(std::numbers::ln2 * metadata_.headroom_hdr_log2)),
      channels_(one_channel ? 1 : 3),
      scale_x_(static_cast<double>(map_.width) / width),
      scale_y_(static_cast<double>(map_.height) / height) {
  for (size_t c = 0; c < 3; ++c) {
    for (size_t i = 0; i < 256; ++i) gains_[c][i] = gain(c, static_cast<double>(i));
  }
}

void GainMap::describe(Image& image) const {
  image.light = PictureLight::kHdr;
  image.peak = peak_;
  absl::StrAppend(&image.signal, ", gain map of ",
                  in_digits(metadata_.headroom_hdr_log2 - metadata_.headroom_base_log2, 2), " stops");
  image.notes.push_back(
      absl::StrFormat("gain map: 1 is reference white, and the picture's peak %s", in_digits(peak_, 3)));
}

void GainMap::apply(uint32_t width, uint32_t y, float* light) const {
  const bool same_size = scale_x_ == 1 && scale_y_ == 1;
  const Neighbours rows = neighbours_in(y, scale_y_, map_.height);
  for (uint32_t x = 0; x < width; ++x, light += 4) {
    std::array<double, 3> gains{};
    if (same_size) {
      const uint8_t* const code = row(y) + size_t{4} * x;
      for (size_t c = 0; c < 3; ++c) gains[c] = gains_[c][code[c]];
    } else {
      const Neighbours columns = neighbours_in(x, scale_x_, map_.width);
      for (size_t c = 0; c < channels_; ++c) {
        const double upper = mix(rows.first, columns, c), lower = mix(rows.second, columns, c);
        gains[c] = gain(c, upper + rows.share * (lower - upper));
      }
      if (channels_ == 1) gains[1] = gains[2] = gains[0];
    }
    for (size_t c = 0; c < 3; ++c) {
      const double hdr = (light[c] + metadata_.offset_sdr[c]) * gains[c] - metadata_.offset_hdr[c];
      light[c] = static_cast<float>(std::clamp<double>(hdr, 0, FLT_MAX));
    }
  }
}

double GainMap::mix(uint32_t y, const Neighbours& columns, size_t c) const {
  const double left = row(y)[size_t{4} * columns.first + c], right = row(y)[size_t{4} * columns.second + c];
  return left + columns.share * (right - left);
}

double GainMap::gain(size_t c, double code) const {
  if (is_apple_) return 1 + (peak_ - 1) * rec709_light(code / 255);
  const double gamma = metadata_.gamma[c], min = metadata_.min_log2[c];
  const double share = gamma == 1 ? code / 255 : power(code / 255, 1 / gamma);
  return exponential(std::numbers::ln2 * (min + (metadata_.max_log2[c] - min) * share));
}

}  // namespace candela
