#include "server/encode/jpeg.h"

// jpeglib.h needs FILE and size_t to be declared before it.
// clang-format off
#include <cstdio>
#include <jpeglib.h>
// clang-format on

#include <csetjmp>
#include <cstdlib>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"
#include "server/encode/gain_map.h"
#include "server/encode/picture.h"

namespace candela {
namespace {

constexpr size_t kMostSegments = 4096;
constexpr uint8_t kStart = 0xd8, kEnd = 0xd9, kScan = 0xda;

uint8_t byte_at(absl::string_view file, size_t at) { return static_cast<uint8_t>(file[at]); }

// Markers without a length: TEM and those that restart a scan.
bool stands_alone(uint8_t marker) { return marker == 0x01 || (marker >= 0xd0 && marker <= 0xd7); }

// Where the codes of a scan end that begin at `at`: at a marker that does not belong to them, or at the end.
size_t scan_end(absl::string_view file, size_t at) {
  while ((at = file.find('\xff', at)) != absl::string_view::npos && at + 1 < file.size()) {
    const uint8_t next = byte_at(file, at + 1);
    if (next != 0 && next != 0xff && !stands_alone(next)) return at;
    at += next == 0xff ? 1 : 2;
  }
  return file.size();
}

}  // namespace

std::optional<absl::string_view> JpegSegments::named(uint8_t marker, absl::string_view name) const {
  for (const JpegSegment& segment : before_scans) {
    if (segment.marker == marker && absl::StartsWith(segment.body, name))
      return segment.body.substr(name.size());
  }
  return std::nullopt;
}

absl::StatusOr<JpegSegments> jpeg_segments(absl::string_view file) {
  if (file.size() < 4 || byte_at(file, 0) != 0xff || byte_at(file, 1) != kStart) {
    return absl::InvalidArgumentError("no JPEG picture begins there");
  }
  JpegSegments found;
  bool in_head = true, before_scans = true;
  for (size_t at = 2; at + 2 <= file.size();) {
    const auto damaged = [&](const char* why) {
      return absl::InvalidArgumentError(absl::StrFormat("%s at byte %d", why, at));
    };
    if (byte_at(file, at) != 0xff) {
      if (before_scans) return damaged("there is no marker");
      ++at;  // libjpeg passes over what is between segments
      continue;
    }
    const uint8_t marker = byte_at(file, at + 1);
    if (marker == 0xff || stands_alone(marker)) {  // 0xff fills
      at += marker == 0xff ? 1 : 2;
      continue;
    }
    if (in_head && marker != kApp0 && marker != kApp1) {
      in_head = false;
      found.after_head = at;
    }
    if (marker == kEnd || (marker == kStart && !before_scans)) {
      found.end = marker == kEnd ? at + 2 : at;
      return found;
    }
    const size_t length =
        at + 4 <= file.size() ? size_t{byte_at(file, at + 2)} << 8 | byte_at(file, at + 3) : 0;
    if (length < 2 || length > file.size() - at - 2) {
      if (before_scans) return damaged("a segment is not whole");
      found.end = at;
      return found;
    }
    if (marker == kScan) {
      before_scans = false;
      at = scan_end(file, at + 2 + length);
      continue;
    }
    if (before_scans) {
      if (found.before_scans.size() == kMostSegments) return damaged("there is one segment too many");
      found.before_scans.push_back({marker, file.substr(at + 4, length - 2)});
    }
    at += 2 + length;
  }
  if (before_scans) return absl::InvalidArgumentError("the file ends before its first scan");
  return found;
}

namespace {

struct JpegFailure {
  jpeg_error_mgr manager;  // first, so that libjpeg's pointer to it is also a pointer to JpegFailure
  std::jmp_buf leave;
  char text[JMSG_LENGTH_MAX] = "";
};

[[noreturn]] void on_error(j_common_ptr codec) {
  auto* failure = reinterpret_cast<JpegFailure*>(codec->err);
  failure->manager.format_message(codec, failure->text);
  std::longjmp(failure->leave, 1);
}

void on_message(j_common_ptr) {}

struct Encoded {
  unsigned char* bytes = nullptr;  // from malloc
  unsigned long size = 0;
};

// False on failure. It has no locals with destructors, because libjpeg leaves it by longjmp.
bool encode(jpeg_compress_struct& codec, JpegFailure& failure, Encoded& out, const JpegCodes& codes,
            int quality, const std::string& profile) {
  codec.err = jpeg_std_error(&failure.manager);
  failure.manager.error_exit = on_error;
  failure.manager.output_message = on_message;
  if (setjmp(failure.leave) != 0) return false;
  jpeg_create_compress(&codec);
  jpeg_mem_dest(&codec, &out.bytes, &out.size);
  codec.image_width = codes.width;
  codec.image_height = codes.height;
  codec.input_components = codes.pixel == JpegPixel::kGrey ? 1 : codes.pixel == JpegPixel::kRgb ? 3 : 4;
  codec.in_color_space = codes.pixel == JpegPixel::kGrey  ? JCS_GRAYSCALE
                         : codes.pixel == JpegPixel::kRgb ? JCS_RGB
                                                          : JCS_EXT_RGBX;  // only libjpeg-turbo has it
  jpeg_set_defaults(&codec);
  jpeg_set_quality(&codec, quality, TRUE);
  for (int i = 0; i < codec.num_components; ++i) {
    codec.comp_info[i].h_samp_factor = codec.comp_info[i].v_samp_factor = 1;
  }
  // Dots per unit, where the unit has no size. Wider pixels mean fewer dots.
  codec.density_unit = 0;
  codec.X_density = codes.aspect_height;
  codec.Y_density = codes.aspect_width;
  jpeg_start_compress(&codec, TRUE);
  if (!profile.empty()) {
    jpeg_write_icc_profile(&codec, reinterpret_cast<const JOCTET*>(profile.data()),
                           static_cast<unsigned>(profile.size()));
  }
  for (uint32_t y = 0; y < codes.height; ++y) {
    auto* row = reinterpret_cast<JSAMPROW>(const_cast<std::byte*>(codes.rows + y * codes.row_stride_bytes));
    jpeg_write_scanlines(&codec, &row, 1);
  }
  jpeg_finish_compress(&codec);
  return true;
}

}  // namespace

absl::Status encode_jpeg_codes(const JpegCodes& codes, int quality, const std::string& profile,
                               ByteSink sink) {
  jpeg_compress_struct codec{};
  JpegFailure failure;
  Encoded encoded;
  const bool whole = encode(codec, failure, encoded, codes, quality, profile);
  jpeg_destroy_compress(&codec);
  if (!whole) {
    // Do not free encoded.bytes: libjpeg may have freed them already while growing the buffer. A rare leak is
    // better than a double free.
    return absl::InternalError(absl::StrFormat("cannot encode the JPEG: %s", failure.text));
  }
  const bool taken = sink(encoded.bytes, encoded.size);
  std::free(encoded.bytes);
  return taken ? absl::OkStatus() : absl::InternalError("cannot encode the JPEG: write failed");
}

namespace {

// Of gain maps. Three channels span three times the stops of one.
constexpr int kGreyMapQuality = 95, kColourMapQuality = 98;

absl::Status encode_base(const PictureView& picture, const JpegOptions& options, ByteSink sink) {
  const JpegCodes codes{picture.width,        picture.height,           JpegPixel::kRgbx,
                        picture.rows,         picture.row_stride_bytes, picture.aspect_width,
                        picture.aspect_height};
  return encode_jpeg_codes(codes, options.quality,
                           options.profile.empty() ? icc_profile(options.transfer) : options.profile, sink);
}

}  // namespace

absl::Status encode_jpeg(const PictureView& picture, const JpegOptions& options, ByteSink sink) {
  if (options.gain_map == nullptr) return encode_base(picture, options, sink);
  std::string base;
  RETURN_IF_ERROR(encode_base(picture, options, [&base](const void* bytes, size_t count) {
    base.append(static_cast<const char*>(bytes), count);
    return true;
  }));
  const GainMapCodes& gain_map = *options.gain_map;
  const bool one_channel = gain_map.metadata.one_channel;
  ASSIGN_OR_RETURN(const std::string map,
                   encode_gain_map(gain_map.codes, picture.width, picture.height, one_channel,
                                   one_channel ? kGreyMapQuality : kColourMapQuality));
  ASSIGN_OR_RETURN(const std::string file, join_gain_map(base, map, gain_map.metadata));
  return sink(file.data(), file.size()) ? absl::OkStatus()
                                        : absl::InternalError("cannot encode the JPEG: write failed");
}

}  // namespace candela
