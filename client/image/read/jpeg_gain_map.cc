#include "client/image/read/jpeg_gain_map.h"

#include <algorithm>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/base/number_words.h"
#include "client/image/color.h"
#include "client/image/power.h"
#include "client/image/read/exif.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Sources: see server/encode/gain_map.cc. The flags 4 and 8 of ISO 21496-1's byte are those that
// google/libultrahdr writes: the base is the HDR picture, and all fractions share a denominator.

constexpr size_t kNowhere = absl::string_view::npos;

absl::Status base_is_hdr() {
  return absl::InvalidArgumentError(
      "its own picture is the HDR one, and the gain map makes the SDR one; Candela reads the reverse");
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

absl::StatusOr<GainMapMetadata> metadata_of_iso(absl::string_view body) {
  IsoNumbers numbers(body);
  const uint32_t least_version = numbers.next(2);
  numbers.next(2);  // the writer's version
  if (least_version != 0) {
    return absl::UnimplementedError(absl::StrFormat(
        "the gain map needs version %d of ISO 21496-1; Candela reads version 0", least_version));
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
  if (!numbers.is_whole()) {
    return absl::InvalidArgumentError("the ISO 21496-1 metadata of the gain map ends too early");
  }
  if ((flags & kIsoBaseIsHdr) != 0 || metadata.headroom_base_log2 > metadata.headroom_hdr_log2) {
    return base_is_hdr();
  }
  return metadata;
}

// ---- XMP, by a search for words ----

// The value of NAME="value" in `text`.
std::optional<absl::string_view> attribute(absl::string_view text, absl::string_view name) {
  for (size_t at = 0; (at = text.find(name, at)) != kNowhere; at += name.size()) {
    if (at == 0 || !absl::ascii_isspace(static_cast<unsigned char>(text[at - 1]))) continue;
    absl::string_view rest = absl::StripLeadingAsciiWhitespace(text.substr(at + name.size()));
    if (!absl::StartsWith(rest, "=")) continue;
    rest = absl::StripLeadingAsciiWhitespace(rest.substr(1));
    if (rest.empty() || (rest[0] != '"' && rest[0] != '\'')) continue;
    const size_t end = rest.find(rest[0], 1);
    if (end != kNowhere) return rest.substr(1, end - 1);
  }
  return std::nullopt;
}

// The text between <NAME> and </NAME>. Removes it from `text`, so the next call finds the next element.
std::optional<absl::string_view> take_element(absl::string_view& text, absl::string_view name) {
  const std::string open = absl::StrCat("<", name, ">"), close = absl::StrCat("</", name, ">");
  const size_t at = text.find(open);
  const size_t end = at == kNowhere ? kNowhere : text.find(close, at);
  if (end == kNowhere) return std::nullopt;
  const absl::string_view inside = text.substr(at + open.size(), end - at - open.size());
  text.remove_prefix(end + close.size());
  return inside;
}

// One number, or three in an rdf:Seq, to `values`. They stay as they are if the name is not there.
absl::Status take_numbers(absl::string_view xmp, absl::string_view name, bool& one_channel,
                          double (&values)[3]) {
  std::optional<absl::string_view> text = attribute(xmp, name);
  if (!text) text = take_element(xmp, name);
  if (!text) return absl::OkStatus();
  std::vector<absl::string_view> words;
  while (const std::optional<absl::string_view> word = take_element(*text, "rdf:li")) {
    words.push_back(*word);
    if (words.size() > 3) break;
  }
  if (words.empty()) words.push_back(*text);
  bool good = words.size() == 1 || words.size() == 3;
  for (size_t i = 0; good && i < 3; ++i) {
    good = absl::SimpleAtod(absl::StripAsciiWhitespace(words[i % words.size()]), &values[i]);
  }
  if (!good) return absl::InvalidArgumentError(absl::StrCat(name, " of the gain map is not 1 or 3 numbers"));
  if (words.size() == 3) one_channel = false;
  return absl::OkStatus();
}

bool has_gain_map_version(absl::string_view xmp) {
  return attribute(xmp, "hdrgm:Version").has_value() || take_element(xmp, "hdrgm:Version").has_value();
}

absl::StatusOr<GainMapMetadata> metadata_of_xmp(absl::string_view xmp) {
  if (attribute(xmp, "hdrgm:BaseRenditionIsHDR") == "True" ||
      take_element(xmp, "hdrgm:BaseRenditionIsHDR") == "True") {
    return base_is_hdr();
  }
  // The values where the file leaves a name out.
  GainMapMetadata metadata{.offset_sdr = {1 / 64.0, 1 / 64.0, 1 / 64.0},
                           .offset_hdr = {1 / 64.0, 1 / 64.0, 1 / 64.0}};
  bool one_headroom = true;
  double base[3] = {0, 0, 0}, hdr[3] = {-1, -1, -1};
  RETURN_IF_ERROR(take_numbers(xmp, "hdrgm:GainMapMin", metadata.one_channel, metadata.min_log2));
  RETURN_IF_ERROR(take_numbers(xmp, "hdrgm:GainMapMax", metadata.one_channel, metadata.max_log2));
  RETURN_IF_ERROR(take_numbers(xmp, "hdrgm:Gamma", metadata.one_channel, metadata.gamma));
  RETURN_IF_ERROR(take_numbers(xmp, "hdrgm:OffsetSDR", metadata.one_channel, metadata.offset_sdr));
  RETURN_IF_ERROR(take_numbers(xmp, "hdrgm:OffsetHDR", metadata.one_channel, metadata.offset_hdr));
  RETURN_IF_ERROR(take_numbers(xmp, "hdrgm:HDRCapacityMin", one_headroom, base));
  RETURN_IF_ERROR(take_numbers(xmp, "hdrgm:HDRCapacityMax", one_headroom, hdr));
  if (hdr[0] == -1) return absl::InvalidArgumentError("the gain map has no hdrgm:HDRCapacityMax");
  metadata.headroom_base_log2 = base[0];
  metadata.headroom_hdr_log2 = hdr[0];
  return metadata;
}

// ---- Where the map is ----

struct Place {
  uint64_t at = 0, bytes = 0;
  const char* source = "";
};

std::vector<Place> places_of_mpf(absl::string_view file, const JpegSegments& segments) {
  constexpr uint32_t kEntries = 0xb002, kEntryBytes = 16;
  std::vector<Place> places;
  const std::optional<absl::string_view> body = segments.named(kApp2, kMpfName);
  if (!body) return places;
  const uint64_t order_at = static_cast<uint64_t>(body->data() - file.data());
  const TiffBytes mpf(*body);
  const std::optional<TiffBytes::Tag> tag = mpf.tag(kEntries);
  if (!tag || tag->count < 2 * kEntryBytes) return places;
  const size_t first = mpf.number_32(tag->value_at).value_or(0);
  for (uint32_t i = 1; i < tag->count / kEntryBytes; ++i) {
    const size_t at = first + size_t{kEntryBytes} * i;
    const std::optional<uint32_t> bytes = mpf.number_32(at + 4), offset = mpf.number_32(at + 8);
    if (!bytes || !offset) break;
    if (*offset > 0) places.push_back({order_at + *offset, *bytes, "MPF"});
  }
  return places;
}

// The files follow each other in the directory's order, behind the first one and its padding.
std::vector<Place> places_of_directory(absl::string_view xmp, const JpegSegments& segments) {
  constexpr absl::string_view kItem = "<Container:Item";
  std::vector<Place> places;
  uint64_t from = segments.end;
  bool is_first = true;
  for (size_t at = 0; segments.end > 0 && (at = xmp.find(kItem, at)) != kNowhere;) {
    const size_t end = std::min(xmp.find('>', at), xmp.size());
    const absl::string_view item = xmp.substr(at + kItem.size(), end - at - kItem.size());
    at = end;
    uint32_t length = 0, padding = 0;
    (void)absl::SimpleAtoi(attribute(item, "Item:Length").value_or("0"), &length);
    (void)absl::SimpleAtoi(attribute(item, "Item:Padding").value_or("0"), &padding);
    if (is_first) length = 0;  // segments.end counts
    if (attribute(item, "Item:Semantic") == "GainMap")
      places.push_back({from, length, "Container directory"});
    from += uint64_t{length} + padding;
    is_first = false;
  }
  return places;
}

// Absent if the picture says nothing of a gain map.
absl::StatusOr<std::optional<GainMapMetadata>> metadata_of(const JpegSegments& map) {
  const std::optional<absl::string_view> iso = map.named(kApp2, kIsoGainMapName);
  const std::optional<absl::string_view> xmp = map.named(kApp1, kXmpName);
  const bool has_xmp = xmp && has_gain_map_version(*xmp);
  if (!iso && !has_xmp) return std::nullopt;
  absl::StatusOr<GainMapMetadata> metadata =
      iso ? metadata_of_iso(*iso) : absl::StatusOr<GainMapMetadata>(absl::UnimplementedError(""));
  if (absl::IsUnimplemented(metadata.status()) && has_xmp) metadata = metadata_of_xmp(*xmp);
  if (absl::IsUnimplemented(metadata.status())) {
    return absl::InvalidArgumentError(metadata.status().message());
  }
  RETURN_IF_ERROR(metadata.status());
  RETURN_IF_ERROR(check_gain_map(*metadata));
  for (int c = 1; metadata->one_channel && c < 3; ++c) {
    for (auto member : {&GainMapMetadata::min_log2, &GainMapMetadata::max_log2, &GainMapMetadata::gamma,
                        &GainMapMetadata::offset_sdr, &GainMapMetadata::offset_hdr}) {
      ((*metadata).*member)[c] = ((*metadata).*member)[0];
    }
  }
  return *metadata;
}

constexpr size_t kMostPlaces = 16;

// Those in the map of a place in the picture.
Neighbours neighbours_in(uint32_t at, double scale, uint32_t count) {
  return neighbours_of((at + 0.5) * scale - 0.5, count);
}

}  // namespace

absl::StatusOr<FoundGainMap> find_gain_map(absl::string_view file, const JpegSegments& segments,
                                           std::vector<std::string>& notes) {
  const absl::string_view xmp = segments.named(kApp1, kXmpName).value_or("");
  const bool announced = has_gain_map_version(xmp) || segments.named(kApp2, kIsoGainMapName);
  std::vector<Place> places = places_of_mpf(file, segments);
  const std::vector<Place> more = places_of_directory(xmp, segments);
  places.insert(places.end(), more.begin(), more.end());
  // Each is looked through to its end, and a file may name as many as it likes.
  if (places.size() > kMostPlaces) places.resize(kMostPlaces);

  absl::Status lost;  // why there is nothing at a place
  for (const Place& place : places) {
    if (place.at > file.size() || place.bytes > file.size() - place.at) {
      lost.Update(absl::InvalidArgumentError(
          absl::StrFormat("its %s places a picture at bytes %d to %d; the file has %d", place.source,
                          place.at, place.at + place.bytes, file.size())));
      continue;
    }
    const absl::string_view jpeg = file.substr(place.at, place.bytes);
    const absl::StatusOr<JpegSegments> found = jpeg_segments(jpeg);
    if (!found.ok()) {
      lost.Update(absl::InvalidArgumentError(absl::StrFormat(
          "its %s places a picture at byte %d: %s", place.source, place.at, found.status().message())));
      continue;
    }
    ASSIGN_OR_RETURN(const std::optional<GainMapMetadata> metadata, metadata_of(*found));
    if (metadata) return FoundGainMap{jpeg, *metadata};
  }
  if (!announced) return FoundGainMap{};  // others, such as small previews, are not used
  RETURN_IF_ERROR(lost);
  notes.push_back("the file says that it has a gain map, but it has none: the SDR picture is shown");
  return FoundGainMap{};
}

GainMap::GainMap(Image map, const GainMapMetadata& metadata, bool one_channel, uint32_t width,
                 uint32_t height)
    : map_(std::move(map)),
      metadata_(metadata),
      channels_(one_channel ? 1 : 3),
      scale_x_(static_cast<double>(map_.width) / width),
      scale_y_(static_cast<double>(map_.height) / height) {
  for (size_t i = 0; i < sdr_.size(); ++i) sdr_[i] = to_linear(ColorCurve::kSrgb, i / 255.0);
  for (size_t c = 0; c < 3; ++c) {
    for (size_t i = 0; i < 256; ++i) gains_[c][i] = gain(c, static_cast<double>(i));
  }
}

void GainMap::describe(Image& image) const {
  image.light = PictureLight::kHdr;
  image.peak = exponential(std::numbers::ln2 * metadata_.headroom_hdr_log2);
  absl::StrAppend(&image.signal, ", gain map of ",
                  in_digits(metadata_.headroom_hdr_log2 - metadata_.headroom_base_log2, 2), " stops");
  image.notes.push_back(
      "gain map: 1 is reference white; exposure is 0 EV and there is no bloom unless they are given");
}

void GainMap::apply(const uint8_t* codes, uint32_t width, uint32_t y, float* light) const {
  const bool same_size = scale_x_ == 1 && scale_y_ == 1;
  const Neighbours rows = neighbours_in(y, scale_y_, map_.height);
  for (uint32_t x = 0; x < width; ++x, codes += 4, light += 4) {
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
      const double hdr = (sdr_[codes[c]] + metadata_.offset_sdr[c]) * gains[c] - metadata_.offset_hdr[c];
      light[c] = static_cast<float>(std::max(hdr, 0.0));
    }
    light[3] = 1;
  }
}

double GainMap::mix(uint32_t y, const Neighbours& columns, size_t c) const {
  const double left = row(y)[size_t{4} * columns.first + c], right = row(y)[size_t{4} * columns.second + c];
  return left + columns.share * (right - left);
}

double GainMap::gain(size_t c, double code) const {
  const double gamma = metadata_.gamma[c], min = metadata_.min_log2[c];
  const double share = gamma == 1 ? code / 255 : power(code / 255, 1 / gamma);
  return exponential(std::numbers::ln2 * (min + (metadata_.max_log2[c] - min) * share));
}

}  // namespace candela
