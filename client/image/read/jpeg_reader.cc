// Reads JPEG files, with their profiles, orientation and gain maps.
// jpeglib.h needs FILE and size_t to be declared before it.
// clang-format off
#include <cstdio>
#include <jpeglib.h>
#include <jerror.h>
// clang-format on

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "client/base/number_words.h"
#include "client/image/color.h"
#include "client/image/power.h"
#include "client/image/read/icc_name.h"
#include "client/image/read/neighbours.h"
#include "client/image/read/readers.h"
#include "client/image/read/signal.h"
#include "server/base/status_macros.h"
#include "server/encode/gain_map.h"
#include "server/encode/jpeg.h"

namespace candela {
namespace {

// Numbers behind a TIFF header, which Exif and MPF begin with. Source: TIFF 6.0, section 2.
class TiffBytes {
 public:
  struct Tag {
    uint32_t type, count;
    size_t value_at;  // four bytes: the value, or where it is
  };

  explicit TiffBytes(absl::string_view bytes);

  // Absent if the bytes end before it, or have no TIFF header.
  std::optional<uint32_t> number_16(size_t at) const { return number(at, 2); }
  std::optional<uint32_t> number_32(size_t at) const { return number(at, 4); }
  // The tag of the first directory; absent if it has none.
  std::optional<Tag> tag(uint32_t id) const;

 private:
  std::optional<uint32_t> number(size_t at, size_t size) const;

  absl::string_view bytes_;
  bool big_endian_;
};

// The profile of all its parts, which are numbered from 1. "" if there is none, or one of them is missing.
// Source: ICC.1:2010, annex B.4.
std::string icc_profile_of(const JpegSegments& segments, bool& is_there) {
  constexpr absl::string_view kIccName{"ICC_PROFILE\0", 12};
  std::array<absl::string_view, 256> parts{};
  size_t count = 0;
  for (const JpegSegment& segment : segments.before_scans) {
    if (segment.marker != kApp2 || !absl::StartsWith(segment.body, kIccName)) continue;
    is_there = true;
    if (segment.body.size() < kIccName.size() + 2) return "";
    count = static_cast<uint8_t>(segment.body[kIccName.size() + 1]);
    parts[static_cast<uint8_t>(segment.body[kIccName.size()])] = segment.body.substr(kIccName.size() + 2);
  }
  std::string profile;
  for (size_t i = 1; i <= count; ++i) {
    if (parts[i].empty()) return "";
    absl::StrAppend(&profile, parts[i]);
  }
  return profile;
}

TiffBytes::TiffBytes(absl::string_view bytes)
    : bytes_(bytes), big_endian_(absl::StartsWith(bytes, absl::string_view("MM\0\x2a", 4))) {
  if (!big_endian_ && !absl::StartsWith(bytes, absl::string_view("II\x2a\0", 4))) bytes_ = {};
}

std::optional<uint32_t> TiffBytes::number(size_t at, size_t size) const {
  if (at > bytes_.size() || bytes_.size() - at < size) return std::nullopt;
  uint32_t v = 0;
  for (size_t i = 0; i < size; ++i) {
    v = v << 8 | static_cast<uint8_t>(bytes_[big_endian_ ? at + i : at + size - 1 - i]);
  }
  return v;
}

std::optional<TiffBytes::Tag> TiffBytes::tag(uint32_t id) const {
  const size_t directory = number_32(4).value_or(0);
  const uint32_t count = number_16(directory).value_or(0);
  for (uint32_t i = 0; i < count; ++i) {
    const size_t at = directory + 2 + size_t{12} * i;
    if (number_16(at) != id) continue;
    const std::optional<uint32_t> type = number_16(at + 2), values = number_32(at + 4);
    if (!type || !values || !number_32(at + 8)) return std::nullopt;
    return Tag{*type, *values, at + 8};
  }
  return std::nullopt;
}

// Exif's orientation, 1 .. 8. 1, which turns nothing, if the file names none.
int orientation_of(const JpegSegments& segments) {
  constexpr absl::string_view kExif{"Exif\0\0", 6};
  constexpr uint32_t kOrientation = 0x112, kShort = 3;
  for (const JpegSegment& segment : segments.before_scans) {
    if (segment.marker != kApp1 || !absl::StartsWith(segment.body, kExif)) continue;
    const TiffBytes exif(segment.body.substr(kExif.size()));
    const std::optional<TiffBytes::Tag> tag = exif.tag(kOrientation);
    if (!tag || tag->type != kShort) return 1;
    const uint32_t turn = exif.number_16(tag->value_at).value_or(1);
    return turn >= 1 && turn <= 8 ? static_cast<int>(turn) : 1;
  }
  return 1;
}

// The signal by the file's ICC profile, else sRGB. Says in `notes` if the profile is not used.
Signal signal_of_jpeg(const JpegSegments& segments, std::vector<std::string>& notes) {
  Signal signal;
  bool has_profile = false;
  const std::string profile = icc_profile_of(segments, has_profile);
  if (!has_profile) return signal;
  // lcms2 would take the memory that a damaged profile asks for.
  const std::string description = icc_name(profile);
  if (description.empty()) {
    notes.push_back("its ICC profile cannot be read: taken as sRGB");
  } else {
    take_profile("ICC", description, signal, notes);
  }
  return signal;
}

// Finds the gain map of a JPEG file and what its codes mean.

struct FoundGainMap {
  absl::string_view jpeg;    // within the file; empty: the file has no gain map
  GainMapMetadata metadata;  // all three channels are filled
};

// Sources: see server/encode/gain_map.cc. The flags 4 and 8 of ISO 21496-1's byte are those that
// google/libultrahdr writes: the base is the HDR picture, and all fractions share a denominator.

constexpr size_t kNowhere = absl::string_view::npos;

absl::Status base_is_hdr() {
  return absl::InvalidArgumentError(
      "its own picture is the HDR one, and the gain map makes the SDR one; Candela reads the reverse");
}

// The body of the first segment with this name, without it.
std::optional<absl::string_view> named(const JpegSegments& segments, uint8_t marker, absl::string_view name) {
  for (const JpegSegment& segment : segments.before_scans) {
    if (segment.marker == marker && absl::StartsWith(segment.body, name))
      return segment.body.substr(name.size());
  }
  return std::nullopt;
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
  const std::optional<absl::string_view> body = named(segments, kApp2, kMpfName);
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
  const std::optional<absl::string_view> iso = named(map, kApp2, kIsoGainMapName);
  const std::optional<absl::string_view> xmp = named(map, kApp1, kXmpName);
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

// Looks for the map by MPF, then by Google's Container directory. Its metadata is ISO 21496-1, or else
// Adobe's XMP. `segments` are those of `file`. Adds a note if the file mentions a map and does not say where
// it is. INVALID_ARGUMENT, whose message does not name the file, if the place is not in the file, or the
// metadata is damaged, or makes an SDR picture of an HDR one.
absl::StatusOr<FoundGainMap> find_gain_map(absl::string_view file, const JpegSegments& segments,
                                           std::vector<std::string>& notes) {
  const absl::string_view xmp = named(segments, kApp1, kXmpName).value_or("");
  const bool announced = has_gain_map_version(xmp) || named(segments, kApp2, kIsoGainMapName);
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

// Reads JPEG files by libjpeg-turbo: grey and RGB pictures of 8 bits, upright. With a gain map, it is the HDR
// picture, for a display that can show all of it; else codes of sRGB, or of the primaries that the file's ICC
// profile names.

constexpr int kMostScans = 500;  // a small file may have very many, and each takes the time of a picture

// libjpeg reports errors by longjmp. So whatever calls it is a function that has nothing to destroy, and
// returns false for an error.
class Jpeg {
 public:
  explicit Jpeg(absl::string_view bytes) : bytes_(bytes) {
    codec_.err = jpeg_std_error(&failure_.manager);
    failure_.manager.error_exit = fail;
    failure_.manager.emit_message = on_message;
    progress_.progress_monitor = count_scans;
  }
  ~Jpeg() { jpeg_destroy_decompress(&codec_); }
  Jpeg(const Jpeg&) = delete;
  Jpeg& operator=(const Jpeg&) = delete;

  bool read_header() {
    if (setjmp(failure_.leave) != 0) return false;
    jpeg_create_decompress(&codec_);
    codec_.progress = &progress_;
    jpeg_mem_src(&codec_, reinterpret_cast<const unsigned char*>(bytes_.data()), bytes_.size());
    jpeg_read_header(&codec_, TRUE);
    return true;
  }
  // Asks for rows of R, G, B and a fourth byte that means nothing.
  bool begin_rows() {
    if (setjmp(failure_.leave) != 0) return false;
    codec_.out_color_space = JCS_EXT_RGBX;
    jpeg_start_decompress(&codec_);
    return true;
  }
  bool read_row(uint8_t* row) {
    if (setjmp(failure_.leave) != 0) return false;
    return jpeg_read_scanlines(&codec_, &row, 1) == 1;
  }
  bool end_rows() {
    if (setjmp(failure_.leave) != 0) return false;
    return jpeg_finish_decompress(&codec_) == TRUE;
  }

  uint32_t width() const { return codec_.image_width; }
  uint32_t height() const { return codec_.image_height; }
  int components() const { return codec_.num_components; }
  bool is_cmyk() const { return codec_.jpeg_color_space == JCS_CMYK || codec_.jpeg_color_space == JCS_YCCK; }
  bool has_color() const { return codec_.jpeg_color_space != JCS_UNKNOWN; }
  // The width of a pixel over its height; 0 if the file does not say it.
  double pixel_aspect() const {
    if (codec_.saw_JFIF_marker == FALSE || codec_.X_density == 0 || codec_.Y_density == 0) return 0;
    return static_cast<double>(codec_.Y_density) / codec_.X_density;
  }
  const char* error() const { return failure_.text; }

 private:
  struct Failure {
    jpeg_error_mgr manager;  // first, so that libjpeg's pointer to it is also a pointer to Failure
    std::jmp_buf leave;
    char text[JMSG_LENGTH_MAX] = "";
  };

  [[noreturn]] static void fail(j_common_ptr codec) {
    auto* failure = reinterpret_cast<Failure*>(codec->err);
    failure->manager.format_message(codec, failure->text);
    std::longjmp(failure->leave, 1);
  }
  // libjpeg only warns of codes that are not there, and goes on with grey.
  static void on_message(j_common_ptr codec, int level) {
    if (level >= 0) return;
    switch (codec->err->msg_code) {
      case JWRN_ARITH_BAD_CODE:
      case JWRN_HIT_MARKER:
      case JWRN_HUFF_BAD_CODE:
      case JWRN_JPEG_EOF:
      case JWRN_MUST_RESYNC:
        fail(codec);
      default:
        return;
    }
  }
  static void count_scans(j_common_ptr codec) {
    if (reinterpret_cast<j_decompress_ptr>(codec)->input_scan_number <= kMostScans) return;
    auto* failure = reinterpret_cast<Failure*>(codec->err);
    std::snprintf(failure->text, sizeof failure->text, "it has more than %d scans", kMostScans);
    std::longjmp(failure->leave, 1);
  }

  absl::string_view bytes_;
  jpeg_decompress_struct codec_{};
  jpeg_progress_mgr progress_{};
  Failure failure_;
};

absl::Status damaged(const std::string& path, const char* what, absl::string_view why) {
  return absl::InvalidArgumentError(absl::StrFormat("%s: damaged %s: %s", path, what, printable(why, 200)));
}

// A picture that the decoder may take memory for. `what` names it in messages.
absl::Status check_kind(const std::string& path, const char* what, const Jpeg& jpeg) {
  if (jpeg.is_cmyk()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: the %s is in CMYK, the inks of a printer; convert it to RGB, such as sRGB", path, what));
  }
  if (jpeg.has_color()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: the %s has %d components; Candela reads grey and RGB", path, what, jpeg.components()));
}

// Turns the stored pixels as Exif's orientation (1 .. 8) says. From 5 on, width and height change places.
class Turned {
 public:
  Turned(int orientation, uint32_t width, uint32_t height)
      : orientation_(orientation), width_(width), height_(height) {}

  bool is_needed() const { return orientation_ != 1; }
  bool swaps() const { return orientation_ >= 5; }
  uint32_t width() const { return swaps() ? height_ : width_; }
  uint32_t height() const { return swaps() ? width_ : height_; }
  std::array<uint32_t, 2> place(uint32_t x, uint32_t y) const {
    if (swaps()) std::swap(x, y);
    const bool from_right = orientation_ == 2 || orientation_ == 3 || orientation_ == 6 || orientation_ == 7;
    const bool from_below = orientation_ == 3 || orientation_ == 4 || orientation_ == 7 || orientation_ == 8;
    return {from_right ? width() - 1 - x : x, from_below ? height() - 1 - y : y};
  }

 private:
  int orientation_;
  uint32_t width_, height_;
};

// Makes HDR light of a picture's rows.
class GainMap {
 public:
  // `map` is kRgba8. The picture that it belongs to has `width` and `height`.
  GainMap(Image map, const GainMapMetadata& metadata, bool one_channel, uint32_t width, uint32_t height)
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

  // Tells the image what it holds, behind what is said of the SDR picture.
  void describe(Image& image) const {
    image.light = PictureLight::kHdr;
    image.peak = exponential(std::numbers::ln2 * metadata_.headroom_hdr_log2);
    absl::StrAppend(&image.signal, ", gain map of ",
                    in_digits(metadata_.headroom_hdr_log2 - metadata_.headroom_base_log2, 2), " stops");
    image.notes.push_back(
        "gain map: 1 is reference white; exposure is 0 EV and there is no bloom unless they are given");
  }

  // `codes` are R, G, B and one more of row `y`; `light` gets them with alpha 1.
  void apply(const uint8_t* codes, uint32_t width, uint32_t y, float* light) const {
    const bool same_size = scale_x_ == 1 && scale_y_ == 1;
    const Neighbours rows = around(y, scale_y_, map_.height);
    for (uint32_t x = 0; x < width; ++x, codes += 4, light += 4) {
      std::array<double, 3> gains{};
      if (same_size) {
        const uint8_t* const code = row(y) + size_t{4} * x;
        for (size_t c = 0; c < 3; ++c) gains[c] = gains_[c][code[c]];
      } else {
        const Neighbours columns = around(x, scale_x_, map_.width);
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

 private:
  // Those in the map of a place in the picture.
  static Neighbours around(uint32_t at, double scale, uint32_t count) {
    return neighbours_of((at + 0.5) * scale - 0.5, count);
  }
  const uint8_t* row(uint32_t y) const {
    return reinterpret_cast<const uint8_t*>(map_.pixels.data()) + y * map_.row_bytes();
  }
  double mix(uint32_t y, const Neighbours& columns, size_t c) const {
    const double left = row(y)[size_t{4} * columns.first + c], right = row(y)[size_t{4} * columns.second + c];
    return left + columns.share * (right - left);
  }
  double gain(size_t c, double code) const {
    const double gamma = metadata_.gamma[c], min = metadata_.min_log2[c];
    const double share = gamma == 1 ? code / 255 : power(code / 255, 1 / gamma);
    return exponential(std::numbers::ln2 * (min + (metadata_.max_log2[c] - min) * share));
  }

  Image map_;
  GainMapMetadata metadata_;
  size_t channels_;
  double scale_x_, scale_y_;
  std::array<double, 256> sdr_{};
  std::array<std::array<double, 256>, 3> gains_{};
};

absl::StatusOr<GainMap> read_gain_map(const std::string& path, const FoundGainMap& found,
                                      const ImageLimits& limits, uint32_t width, uint32_t height) {
  constexpr char kWhat[] = "gain map";
  Jpeg jpeg(found.jpeg);
  if (!jpeg.read_header()) return damaged(path, kWhat, jpeg.error());
  RETURN_IF_ERROR(check_kind(path, kWhat, jpeg));
  RETURN_IF_ERROR(check_image_size(path, kWhat, jpeg.width(), jpeg.height(), ImageFormat::kRgba8, limits));
  ASSIGN_OR_RETURN(Image map, image_to_overwrite(jpeg.width(), jpeg.height(), ImageFormat::kRgba8));
  bool whole = jpeg.begin_rows();
  for (uint32_t y = 0; whole && y < map.height; ++y) {
    whole = jpeg.read_row(reinterpret_cast<uint8_t*>(map.pixels.data() + y * map.row_bytes()));
  }
  if (!whole || !jpeg.end_rows()) return damaged(path, kWhat, jpeg.error());
  const bool one_channel = found.metadata.one_channel && jpeg.components() == 1;
  return GainMap(std::move(map), found.metadata, one_channel, width, height);
}

// The gain map of the file, if it has one and the choice does not overrule it.
absl::StatusOr<std::optional<GainMap>> gain_map_of(const std::string& path, absl::string_view file,
                                                   const JpegSegments& segments, const Jpeg& base,
                                                   const ImageLimits& limits, const PictureChoice& choice,
                                                   Image& image) {
  if (choice.keeps_signal) return std::nullopt;
  std::vector<std::string> notes;
  absl::StatusOr<FoundGainMap> found = find_gain_map(file, segments, notes);
  if (choice.transfer) {
    if (!found.ok() || !found->jpeg.empty()) {
      image.notes.push_back("its gain map is not used, because --input-transfer says what the codes are");
    }
    return std::nullopt;
  }
  image.notes.insert(image.notes.end(), notes.begin(), notes.end());
  if (!found.ok()) return damaged(path, "gain map", found.status().message());
  if (found->jpeg.empty()) return std::nullopt;
  if (!found->metadata.base_primaries && !found->metadata.one_channel) {
    image.notes.push_back(
        "its gain map is of light in the HDR picture's primaries; the SDR picture's are taken");
  }
  return read_gain_map(path, *found, limits, base.width(), base.height());
}

// Rows until one cannot be read. Returns how many.
uint32_t read_jpeg_rows(Jpeg& jpeg, const SignalDecoder& decoder, const std::optional<GainMap>& map,
                        const Turned& turned, Image& image) {
  const uint32_t width = jpeg.width();
  std::vector<uint8_t> codes(size_t{4} * width);
  std::vector<uint16_t> wide(codes.size(), 65535);
  std::vector<float> light(codes.size());
  const auto pixel = [&image](uint32_t x, uint32_t y) {
    return reinterpret_cast<float*>(image.pixels.data() + y * image.row_bytes()) + size_t{4} * x;
  };
  for (uint32_t y = 0; y < jpeg.height(); ++y) {
    if (!jpeg.read_row(codes.data())) return y;
    float* const to = turned.is_needed() ? light.data() : pixel(0, y);
    if (map) {
      map->apply(codes.data(), width, y, to);
    } else {
      for (size_t i = 0; i < codes.size(); ++i) {
        if (i % 4 != 3) wide[i] = static_cast<uint16_t>(codes[i] * 257);
      }
      decoder.decode(wide, to);
    }
    for (uint32_t x = 0; turned.is_needed() && x < width; ++x) {
      const auto [to_x, to_y] = turned.place(x, y);
      std::copy_n(light.data() + size_t{4} * x, 4, pixel(to_x, to_y));
    }
  }
  return jpeg.height();
}

}  // namespace

absl::StatusOr<Image> read_jpeg(FileReader& file, const ImageLimits& limits, const PictureChoice& choice) {
  constexpr char kWhat[] = "JPEG file";
  if (file.remaining() > limits.max_bytes) {
    return absl::ResourceExhaustedError(absl::StrFormat("%s: the file has %d bytes; the limit is %d",
                                                        file.path(), file.remaining(), limits.max_bytes));
  }
  std::vector<char> bytes(file.remaining());
  if (!file.read(std::as_writable_bytes(std::span(bytes)))) return file.truncated("its end");
  const absl::string_view all(bytes.data(), bytes.size());
  const absl::StatusOr<JpegSegments> segments = jpeg_segments(all);
  if (!segments.ok()) return damaged(file.path(), kWhat, segments.status().message());
  Jpeg jpeg(all);
  if (!jpeg.read_header()) return damaged(file.path(), kWhat, jpeg.error());
  RETURN_IF_ERROR(check_kind(file.path(), "picture", jpeg));
  const Turned turned(orientation_of(*segments), jpeg.width(), jpeg.height());
  constexpr ImageFormat kFormat = ImageFormat::kRgba32f;
  RETURN_IF_ERROR(check_image_size(file.path(), "image", turned.width(), turned.height(), kFormat, limits));
  ASSIGN_OR_RETURN(Image image, make_image(turned.width(), turned.height(), kFormat));
  if (const double aspect = jpeg.pixel_aspect(); aspect > 0) {
    set_pixel_aspect(turned.swaps() ? 1 / aspect : aspect, image);
  }
  Signal signal = signal_of_jpeg(*segments, image.notes);
  absl::StatusOr<std::optional<GainMap>> map =
      gain_map_of(file.path(), all, *segments, jpeg, limits, choice, image);
  if (!map.ok() && absl::IsInvalidArgument(map.status())) {
    if (!choice.fills_gaps) return or_fill(map.status());
    image.notes.push_back(absl::StrCat(absl::StripPrefix(map.status().message(), file.path() + ": "),
                                       "; the SDR picture is shown"));
    map = std::nullopt;
  }
  RETURN_IF_ERROR(map.status());
  if (map->has_value() && signal.transfer != SignalTransfer::kSrgb) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: its profile says PQ or HLG, which has no gain map; --input-transfer leaves the map out",
        file.path()));
  }
  const SignalDecoder decoder(std::move(signal), choice);
  decoder.describe(8, image);
  if (map->has_value()) (*map)->describe(image);

  const uint32_t rows = jpeg.begin_rows() ? read_jpeg_rows(jpeg, decoder, *map, turned, image) : 0;
  if (rows == jpeg.height() && (jpeg.end_rows() || choice.fills_gaps)) return image;
  const absl::Status status = damaged(file.path(), kWhat, jpeg.error());
  if (rows == 0) return status;
  if (!choice.fills_gaps) return or_fill(status);
  note_missing(file.path(), status, uint64_t{jpeg.height() - rows} * jpeg.width(), image);
  return image;
}

}  // namespace candela
