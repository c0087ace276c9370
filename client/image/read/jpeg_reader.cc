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
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "client/image/read/exif.h"
#include "client/image/read/icc_profile.h"
#include "client/image/read/jpeg_gain_map.h"
#include "client/image/read/readers.h"
#include "client/image/read/signal.h"
#include "server/base/status_macros.h"
#include "server/encode/jpeg.h"

namespace candela {
namespace {

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

// The signal by the file's ICC profile, else by Exif, else sRGB. Says in `notes` if the profile is not used.
// `components` are the picture's: 4 are inks.
Signal signal_of_jpeg(const JpegSegments& segments, int components, std::vector<std::string>& notes) {
  Signal signal{.inks = components == 4};
  bool has_profile = false;
  const std::string profile = icc_profile_of(segments, has_profile);
  if (has_profile) take_profile("ICC", profile, components, signal, notes);
  if (signal.source.empty() && is_adobe_rgb(segments.named(kApp1, kExifName).value_or(""))) {
    set_adobe_rgb(signal);
  }
  return signal;
}

// Reads JPEG files by libjpeg-turbo: pictures in grey, RGB and CMYK of 8 bits, upright. With a gain map, it is the HDR
// picture, for a display that can show all of it; else codes of what its ICC profile says, or of sRGB.

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
  // Asks for rows of R, G, B and a fourth byte that means nothing; of inks for C, M, Y and K.
  bool begin_rows() {
    if (setjmp(failure_.leave) != 0) return false;
    codec_.out_color_space = is_cmyk() ? JCS_CMYK : JCS_EXT_RGBX;
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
  // Adobe's programs store inks inverted: 255 is none.
  bool has_inverted_inks() const { return codec_.saw_Adobe_marker == TRUE; }
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
  const int inverted = jpeg.is_cmyk() && jpeg.has_inverted_inks() ? 255 : 0;
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
        if (i % 4 != 3 || jpeg.is_cmyk()) wide[i] = static_cast<uint16_t>((codes[i] ^ inverted) * 257);
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
  if (!jpeg.is_cmyk()) RETURN_IF_ERROR(check_kind(file.path(), "picture", jpeg));
  const Turned turned(orientation_of(segments->named(kApp1, kExifName).value_or("")), jpeg.width(),
                      jpeg.height());
  constexpr ImageFormat kFormat = ImageFormat::kRgba32f;
  RETURN_IF_ERROR(check_image_size(file.path(), "image", turned.width(), turned.height(), kFormat, limits));
  ASSIGN_OR_RETURN(Image image, make_image(turned.width(), turned.height(), kFormat));
  if (const double aspect = jpeg.pixel_aspect(); aspect > 0) {
    set_pixel_aspect(turned.swaps() ? 1 / aspect : aspect, image);
  }
  Signal signal = signal_of_jpeg(*segments, jpeg.components(), image.notes);
  absl::StatusOr<std::optional<GainMap>> map =
      gain_map_of(file.path(), all, *segments, jpeg, limits, choice, image);
  if (!map.ok() && absl::IsInvalidArgument(map.status())) {
    if (!choice.fills_gaps) return or_fill(map.status());
    image.notes.push_back(absl::StrCat(absl::StripPrefix(map.status().message(), file.path() + ": "),
                                       "; the SDR picture is shown"));
    map = std::nullopt;
  }
  RETURN_IF_ERROR(map.status());
  if (map->has_value() && !signal.inks &&
      (signal.transfer == SignalTransfer::kPq || signal.transfer == SignalTransfer::kHlg)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: its profile says PQ or HLG, which has no gain map; --input-transfer leaves the map out",
        file.path()));
  }
  if (map->has_value() && (signal.inks || signal.transfer != SignalTransfer::kSrgb)) {
    image.notes.emplace_back("its gain map is not used: the SDR picture does not have sRGB's curve");
    map->reset();
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
