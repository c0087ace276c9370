// Sources: ISO 21496-1:2025, annex C; Adobe, "Gain map specification" 1.0; Google, "Ultra HDR image format"
// 1.1; CIPA DC-007. The layouts agree with those of google/libultrahdr.
#include "server/encode/gain_map.h"

#include <cmath>
#include <limits>
#include <tuple>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"
#include "server/encode/jpeg.h"

namespace candela {
namespace {

void add_16(uint32_t v, std::string& to) {
  to.push_back(static_cast<char>(v >> 8));
  to.push_back(static_cast<char>(v));
}
void add_32(uint32_t v, std::string& to) {
  add_16(v >> 16, to);
  add_16(v, to);
}

// A segment of less than 64 KiB.
std::string segment(uint8_t marker, absl::string_view name, absl::string_view body) {
  std::string bytes = {'\xff', static_cast<char>(marker)};
  add_16(static_cast<uint32_t>(2 + name.size() + body.size()), bytes);
  absl::StrAppend(&bytes, name, body);
  return bytes;
}

// ---- ISO 21496-1 ----

struct Fraction {
  int32_t numerator;
  uint32_t denominator;
};

// The last fraction of the continued one whose terms fit, so that 1/64 and 1e-7 are exact. |v| is at most
// 100.
Fraction fraction_of(double v) {
  constexpr double kMost = std::numeric_limits<int32_t>::max();
  double n = 1, d = 0, old_n = 0, old_d = 1;
  for (double rest = std::fabs(v); rest <= kMost;) {
    const double whole = std::floor(rest);
    const double next_n = whole * n + old_n, next_d = whole * d + old_d;
    if (next_n > kMost || next_d > kMost) break;
    old_n = n;
    old_d = d;
    n = next_n;
    d = next_d;
    if (rest == whole || n / d == std::fabs(v)) break;
    rest = 1 / (rest - whole);
  }
  return {static_cast<int32_t>(std::copysign(n, v)), static_cast<uint32_t>(d)};
}

void add_fraction(double v, std::string& to) {
  const Fraction fraction = fraction_of(v);
  add_32(static_cast<uint32_t>(fraction.numerator), to);
  add_32(fraction.denominator, to);
}

constexpr absl::string_view kIsoVersion{"\0\0\0\0", 4};  // minimum_version 0, writer_version 0

std::string iso_segment(const GainMapMetadata& metadata) {
  std::string body(kIsoVersion);
  body.push_back(static_cast<char>((metadata.base_primaries ? kIsoBaseColours : 0) |
                                   (metadata.one_channel ? 0 : kIsoThreeChannels)));
  add_fraction(metadata.headroom_base_log2, body);
  add_fraction(metadata.headroom_hdr_log2, body);
  for (int c = 0; c < (metadata.one_channel ? 1 : 3); ++c) {
    add_fraction(metadata.min_log2[c], body);
    add_fraction(metadata.max_log2[c], body);
    add_fraction(metadata.gamma[c], body);
    add_fraction(metadata.offset_sdr[c], body);
    add_fraction(metadata.offset_hdr[c], body);
  }
  return segment(kApp2, kIsoGainMapName, body);
}

// ---- XMP ----

// Without an exponent, because not every reader of XMP takes one.
std::string digits(double v) {
  std::string text = absl::StrFormat("%.10f", v);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text == "-0" ? "0" : text;
}

// `attributes` and `elements` are those of the one rdf:Description.
std::string xmp_segment(absl::string_view attributes, absl::string_view elements) {
  return segment(
      kApp1, kXmpName,
      absl::StrCat("<x:xmpmeta xmlns:x=\"adobe:ns:meta/\">"
                   "<rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">"
                   "<rdf:Description rdf:about=\"\" xmlns:hdrgm=\"http://ns.adobe.com/hdr-gain-map/1.0/\""
                   " hdrgm:Version=\"1.0\"",
                   attributes, ">", elements, "</rdf:Description></rdf:RDF></x:xmpmeta>"));
}

std::string base_xmp_segment(size_t map_bytes) {
  constexpr absl::string_view kSpaces =
      " xmlns:Container=\"http://ns.google.com/photos/1.0/container/\""
      " xmlns:Item=\"http://ns.google.com/photos/1.0/container/item/\"";
  const auto item = [](absl::string_view semantic, absl::string_view more) {
    return absl::StrCat("<rdf:li rdf:parseType=\"Resource\"><Container:Item Item:Semantic=\"", semantic,
                        "\" Item:Mime=\"image/jpeg\"", more, "/></rdf:li>");
  };
  return xmp_segment(kSpaces, absl::StrCat("<Container:Directory><rdf:Seq>", item("Primary", ""),
                                           item("GainMap", absl::StrCat(" Item:Length=\"", map_bytes, "\"")),
                                           "</rdf:Seq></Container:Directory>"));
}

std::string map_xmp_segment(const GainMapMetadata& metadata) {
  std::string attributes = absl::StrCat(" hdrgm:HDRCapacityMin=\"", digits(metadata.headroom_base_log2),
                                        "\" hdrgm:HDRCapacityMax=\"", digits(metadata.headroom_hdr_log2),
                                        "\" hdrgm:BaseRenditionIsHDR=\"False\"");
  std::string elements;
  const auto add = [&](absl::string_view name, const double(&values)[3]) {
    if (metadata.one_channel) {
      absl::StrAppend(&attributes, " hdrgm:", name, "=\"", digits(values[0]), "\"");
      return;
    }
    absl::StrAppend(&elements, "<hdrgm:", name, "><rdf:Seq>");
    for (const double v : values) absl::StrAppend(&elements, "<rdf:li>", digits(v), "</rdf:li>");
    absl::StrAppend(&elements, "</rdf:Seq></hdrgm:", name, ">");
  };
  add("GainMapMin", metadata.min_log2);
  add("GainMapMax", metadata.max_log2);
  add("Gamma", metadata.gamma);
  add("OffsetSDR", metadata.offset_sdr);
  add("OffsetHDR", metadata.offset_hdr);
  return xmp_segment(attributes, elements);
}

// ---- MPF ----

constexpr size_t kMpfSegmentBytes = 90;
constexpr size_t kMpfOrderAt = 8;  // the byte-order mark in the segment

// `map_offset` counts from the byte-order mark.
std::string mpf_segment(size_t base_bytes, size_t map_bytes, size_t map_offset) {
  constexpr uint32_t kLong = 4, kUndefined = 7, kBaselinePrimary = 0x030000;
  std::string body("MM\0\x2a\0\0\0\x08", 8);  // big endian; the index follows
  const auto add_tag = [&body](uint32_t tag, uint32_t type, uint32_t count) {
    add_16(tag, body);
    add_16(type, body);
    add_32(count, body);
  };
  add_16(3, body);  // tags
  add_tag(0xb000, kUndefined, 4);
  body += "0100";  // the version
  add_tag(0xb001, kLong, 1);
  add_32(2, body);  // pictures
  add_tag(0xb002, kUndefined, 32);
  add_32(static_cast<uint32_t>(body.size() + 8), body);  // where the entries are
  add_32(0, body);                                       // no other index
  for (const auto& [kind, bytes, offset] :
       {std::tuple(kBaselinePrimary, base_bytes, size_t{0}), std::tuple(0u, map_bytes, map_offset)}) {
    add_32(kind, body);
    add_32(static_cast<uint32_t>(bytes), body);
    add_32(static_cast<uint32_t>(offset), body);
    add_32(0, body);  // it depends on no other
  }
  return segment(kApp2, kMpfName, body);
}

// Where new segments go into a file that is one whole picture.
absl::StatusOr<size_t> place_in(absl::string_view jpeg, absl::string_view what) {
  const absl::StatusOr<JpegSegments> segments = jpeg_segments(jpeg);
  if (!segments.ok()) {
    return absl::InvalidArgumentError(absl::StrCat("the ", what, ": ", segments.status().message()));
  }
  if (segments->end != jpeg.size()) {
    return absl::InvalidArgumentError(absl::StrCat("the ", what, " is not one whole JPEG picture"));
  }
  return segments->after_head;
}

}  // namespace

std::optional<GainMapCodes> gain_map_in_alpha(const PictureView& picture, double max_log2) {
  if (max_log2 <= 0) return std::nullopt;
  GainMapCodes map;
  map.metadata.max_log2[0] = map.metadata.headroom_hdr_log2 = max_log2;
  map.codes.reserve(size_t{picture.width} * picture.height);
  for (uint32_t y = 0; y < picture.height; ++y) {
    const std::byte* const row = picture.row(y);
    for (uint32_t x = 0; x < picture.width; ++x)
      map.codes.push_back(std::to_integer<uint8_t>(row[4 * x + 3]));
  }
  return map;
}

absl::Status check_gain_map(const GainMapMetadata& metadata) {
  absl::Status status;
  const auto check = [&status](const char* what, double v, double least, double most) {
    if (status.ok() && !(v >= least && v <= most)) {
      status = absl::InvalidArgumentError(
          absl::StrFormat("%s of the gain map is %g; it must be within %g .. %g", what, v, least, most));
    }
  };
  for (int c = 0; c < (metadata.one_channel ? 1 : 3); ++c) {
    check("the minimum", metadata.min_log2[c], -64, 64);
    check("the maximum", metadata.max_log2[c], metadata.min_log2[c], 64);
    check("the gamma", metadata.gamma[c], 0.01, 100);
    check("the SDR offset", metadata.offset_sdr[c], -64, 64);
    check("the HDR offset", metadata.offset_hdr[c], -64, 64);
  }
  check("the base's headroom", metadata.headroom_base_log2, 0, 64);
  check("the HDR picture's headroom", metadata.headroom_hdr_log2, metadata.headroom_base_log2, 64);
  return status;
}

absl::StatusOr<std::string> encode_gain_map(std::span<const uint8_t> codes, uint32_t width, uint32_t height,
                                            bool one_channel, int quality) {
  const size_t row_bytes = size_t{width} * (one_channel ? 1 : 3);
  if (codes.size() != row_bytes * height) {
    return absl::InternalError(absl::StrFormat("a gain map of %dx%d pixels has %d codes; it must have %d",
                                               width, height, codes.size(), row_bytes * height));
  }
  const JpegCodes rows{.width = width,
                       .height = height,
                       .pixel = one_channel ? JpegPixel::kGrey : JpegPixel::kRgb,
                       .rows = reinterpret_cast<const std::byte*>(codes.data()),
                       .row_stride_bytes = row_bytes};
  std::string file;
  RETURN_IF_ERROR(encode_jpeg_codes(rows, quality, "", [&file](const void* bytes, size_t count) {
    file.append(static_cast<const char*>(bytes), count);
    return true;
  }));
  return file;
}

absl::StatusOr<std::string> join_gain_map(absl::string_view base_jpeg, absl::string_view map_jpeg,
                                          const GainMapMetadata& metadata) {
  RETURN_IF_ERROR(check_gain_map(metadata));
  ASSIGN_OR_RETURN(const size_t base_place, place_in(base_jpeg, "base"));
  ASSIGN_OR_RETURN(const size_t map_place, place_in(map_jpeg, "gain map"));

  const std::string in_map = map_xmp_segment(metadata) + iso_segment(metadata);
  const size_t map_bytes = map_jpeg.size() + in_map.size();
  const std::string in_base = base_xmp_segment(map_bytes) + segment(kApp2, kIsoGainMapName, kIsoVersion);
  const size_t base_bytes = base_jpeg.size() + in_base.size() + kMpfSegmentBytes;
  if (base_bytes + map_bytes > std::numeric_limits<uint32_t>::max()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "the picture and its gain map have %d bytes; MPF allows 4294967295", base_bytes + map_bytes));
  }
  const size_t order_at = base_place + in_base.size() + kMpfOrderAt;

  std::string file;
  file.reserve(base_bytes + map_bytes);
  absl::StrAppend(&file, base_jpeg.substr(0, base_place), in_base,
                  mpf_segment(base_bytes, map_bytes, base_bytes - order_at), base_jpeg.substr(base_place));
  absl::StrAppend(&file, map_jpeg.substr(0, map_place), in_map, map_jpeg.substr(map_place));
  return file;
}

}  // namespace candela
