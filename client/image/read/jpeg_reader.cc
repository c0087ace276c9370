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
#include <numbers>
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
#include "client/image/power.h"
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

// Refuses by name what libjpeg does not decode. Source: ITU-T T.81, table B.1; T.87 (JPEG-LS).
absl::Status check_process(const std::string& path, const JpegSegments& segments) {
  for (const JpegSegment& segment : segments.before_scans) {
    const uint8_t marker = segment.marker;
    const bool is_ls = marker == 0xf7;
    const bool is_frame =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (!is_ls && !is_frame) continue;
    const int bits = segment.body.empty() ? 8 : static_cast<uint8_t>(segment.body[0]);
    const bool is_lossless = marker % 4 == 3, is_hierarchical = (marker & 4) != 0;
    if (!is_ls && !is_lossless && !is_hierarchical && bits == 8) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: this is a%s of %d bits; Candela reads baseline and progressive JPEGs of 8 bits; "
                        "convert it to PNG",
                        path,
                        is_ls             ? " JPEG-LS file"
                        : is_lossless     ? " lossless JPEG"
                        : is_hierarchical ? " hierarchical JPEG"
                                          : " JPEG",
                        bits));
  }
  return absl::OkStatus();
}

// Reads JPEG files by libjpeg-turbo: pictures in grey, RGB and CMYK of 8 bits, upright. With a gain map, it
// is the HDR picture, for a display that can show all of it; else codes of what its ICC profile says, or of
// sRGB. The mark of a picture's end may be missing.

constexpr int kMostScans = 500;  // a small file may have very many, and each takes the time of a picture

// libjpeg reports errors by longjmp. So whatever calls it is a function that has nothing to destroy, and
// returns false for an error.
class Jpeg {
 public:
  // `fills_gaps`: damage ends what is whole, and is no error.
  explicit Jpeg(absl::string_view bytes, bool fills_gaps = false) : bytes_(bytes) {
    failure_.fills_gaps = fills_gaps;
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
  // Asks for rows of R, G, B and a fourth byte that means nothing; of inks for C, M, Y and K. A picture of
  // several scans is read here.
  bool begin_rows() {
    if (setjmp(failure_.leave) != 0) return false;
    failure_.whole_rows = height();
    codec_.out_color_space = is_cmyk() ? JCS_CMYK : JCS_EXT_RGBX;
    jpeg_start_decompress(&codec_);
    if (failure_.file_ends && lacks_scans()) on_damage(reinterpret_cast<j_common_ptr>(&codec_));
    return true;
  }
  bool read_row(uint8_t* row) {
    if (setjmp(failure_.leave) != 0) return false;
    return jpeg_read_scanlines(&codec_, &row, 1) == 1;
  }

  // How many rows from the top have no damage that is known by now.
  uint32_t whole_rows() const { return failure_.whole_rows; }
  bool is_damaged() const { return failure_.is_damaged; }
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
    char text[JMSG_LENGTH_MAX] = "";  // the first message
    bool fills_gaps = false, file_ends = false, is_damaged = false;
    uint32_t whole_rows = 0;
  };

  static Failure& failure_of(j_common_ptr codec) { return *reinterpret_cast<Failure*>(codec->err); }

  static void keep_message(j_common_ptr codec) {
    Failure& failure = failure_of(codec);
    if (failure.text[0] == '\0') failure.manager.format_message(codec, failure.text);
  }
  [[noreturn]] static void fail(j_common_ptr codec) {
    Failure& failure = failure_of(codec);
    keep_message(codec);
    failure.whole_rows =
        std::min(failure.whole_rows, reinterpret_cast<j_decompress_ptr>(codec)->output_scanline);
    std::longjmp(failure.leave, 1);
  }
  // libjpeg only warns of codes that are not there, and goes on with grey. That the file ends is no damage:
  // codes that are missing then are warned of, too.
  static void on_message(j_common_ptr codec, int level) {
    if (level >= 0) return;
    switch (codec->err->msg_code) {
      case JWRN_JPEG_EOF:
        failure_of(codec).file_ends = true;
        keep_message(codec);
        // Of an arithmetic code the end may be left out where it is zeros, so libjpeg cannot know.
        if (reinterpret_cast<j_decompress_ptr>(codec)->arith_code != FALSE) on_damage(codec);
        return;
      case JWRN_ARITH_BAD_CODE:
      case JWRN_HIT_MARKER:
      case JWRN_HUFF_BAD_CODE:
      case JWRN_MUST_RESYNC:
        on_damage(codec);
        return;
      default:
        return;
    }
  }
  static void on_damage(j_common_ptr codec) {
    Failure& failure = failure_of(codec);
    failure.is_damaged = true;
    const auto* const jpeg = reinterpret_cast<j_decompress_ptr>(codec);
    // Later scans of a progressive picture refine rows that are there.
    const bool refines = jpeg->progressive_mode != FALSE && (jpeg->Ss > 0 || jpeg->Ah > 0);
    const uint32_t row_of_blocks = static_cast<uint32_t>(jpeg->max_v_samp_factor) * DCTSIZE;
    if (!refines) failure.whole_rows = std::min(failure.whole_rows, jpeg->input_iMCU_row * row_of_blocks);
    keep_message(codec);
    if (!failure.fills_gaps) std::longjmp(failure.leave, 1);
  }
  static void count_scans(j_common_ptr codec) {
    if (reinterpret_cast<j_decompress_ptr>(codec)->input_scan_number <= kMostScans) return;
    Failure& failure = failure_of(codec);
    std::snprintf(failure.text, sizeof failure.text, "it has more than %d scans", kMostScans);
    failure.whole_rows = 0;
    std::longjmp(failure.leave, 1);
  }

  // Whether a file that ends without its mark ends before its last scan.
  bool lacks_scans() const {
    for (int c = 0; c < codec_.num_components; ++c) {
      if (codec_.comp_info[c].quant_table == nullptr)
        return true;  // libjpeg sets it at the component's first
      for (int k = 0; codec_.progressive_mode != FALSE && k < DCTSIZE2; ++k) {
        if (codec_.coef_bits[c][k] != 0) return true;
      }
    }
    return false;
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

// The gain map of the file, if it has one that can be used and the choice does not overrule it. Tells the
// image, of which all else is known, that there is one, or why it is not used.
absl::StatusOr<std::optional<GainMap>> gain_map_of(const std::string& path, absl::string_view file,
                                                   const JpegSegments& segments, const Jpeg& base,
                                                   const ImageLimits& limits, const PictureChoice& choice,
                                                   Image& image) {
  constexpr char kWhat[] = "gain map";
  if (choice.keeps_signal) return std::nullopt;
  const absl::StatusOr<FoundGainMap> found = find_gain_map(file, segments);
  image.has_gain_map = found.ok() && !found->jpeg.empty();
  if (found.ok() && !image.has_gain_map) return std::nullopt;
  if (choice.base_of_gain_map && !(found.ok() && found->base_is_hdr)) return std::nullopt;
  if (choice.transfer) {
    image.notes.push_back("its gain map is not used, because --input-transfer says what the codes are");
    return std::nullopt;
  }
  const auto unused = [&](absl::string_view why) {
    absl::ConsumePrefix(&why, path + ": ");
    image.notes.push_back(
        absl::StrFormat("its gain map is not used: %s; the picture without it is shown", why));
    return std::nullopt;
  };
  if (!found.ok()) return unused(found.status().message());
  if (found->base_is_hdr) {
    if (image.light == PictureLight::kHdr) {
      image.peak = exponential(std::numbers::ln2 * found->metadata.headroom_hdr_log2);
    }
    image.notes.push_back("its own picture is the HDR one and is shown: its gain map makes the SDR one");
    return std::nullopt;
  }
  if (image.light == PictureLight::kHdr)
    return unused("its profile says PQ or HLG, which is HDR without a map");
  Jpeg jpeg(found->jpeg);
  if (!jpeg.read_header()) return unused(damaged(path, kWhat, jpeg.error()).message());
  absl::Status usable = check_kind(path, kWhat, jpeg);
  usable.Update(check_image_size(path, kWhat, jpeg.width(), jpeg.height(), ImageFormat::kRgba8, limits));
  if (!usable.ok()) return unused(usable.message());
  ASSIGN_OR_RETURN(Image map, image_to_overwrite(jpeg.width(), jpeg.height(), ImageFormat::kRgba8));
  bool whole = jpeg.begin_rows();
  for (uint32_t y = 0; whole && y < map.height; ++y) {
    whole = jpeg.read_row(reinterpret_cast<uint8_t*>(map.pixels.data() + y * map.row_bytes()));
  }
  if (!whole) return unused(damaged(path, kWhat, jpeg.error()).message());
  if (!found->metadata.base_primaries && !found->metadata.one_channel) {
    image.notes.push_back(
        "its gain map is of light in the HDR picture's primaries; the SDR picture's are taken");
  }
  const bool one_channel = found->metadata.one_channel && (found->is_apple || jpeg.components() == 1);
  return GainMap(std::move(map), *found, one_channel, base.width(), base.height());
}

// Rows until one cannot be read. Returns how many.
uint32_t read_jpeg_rows(Jpeg& jpeg, const SignalDecoder& decoder, const std::optional<GainMap>& map,
                        const Turned& turned, Image& image) {
  const uint32_t width = jpeg.width();
  std::vector<uint8_t> codes(size_t{4} * width);
  std::vector<uint16_t> wide(codes.size(), 65535);
  std::vector<float> light(codes.size());
  const int inverted = jpeg.is_cmyk() && jpeg.has_inverted_inks() ? 255 : 0;
  for (uint32_t y = 0; y < jpeg.height(); ++y) {
    if (!jpeg.read_row(codes.data()) || y >= jpeg.whole_rows()) return y;
    for (size_t i = 0; i < codes.size(); ++i) {
      if (i % 4 != 3 || jpeg.is_cmyk()) wide[i] = static_cast<uint16_t>((codes[i] ^ inverted) * 257);
    }
    decoder.decode(wide, light.data());
    if (map) map->apply(width, y, light.data());
    turned.put_row(light, y, image);
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
  RETURN_IF_ERROR(check_process(file.path(), *segments));
  Jpeg jpeg(segments->end > 0 ? all.substr(0, segments->end) : all, choice.fills_gaps);
  if (!jpeg.read_header()) return damaged(file.path(), kWhat, jpeg.error());
  if (!jpeg.is_cmyk()) RETURN_IF_ERROR(check_kind(file.path(), "picture", jpeg));
  const int orientation = orientation_of(segments->named(kApp1, kExifName).value_or(""));
  const Turned turned(orientation, jpeg.width(), jpeg.height());
  constexpr ImageFormat kFormat = ImageFormat::kRgba32f;
  RETURN_IF_ERROR(check_image_size(file.path(), "image", turned.width(), turned.height(), kFormat, limits));
  ASSIGN_OR_RETURN(Image image, make_image(turned.width(), turned.height(), kFormat));
  if (const double aspect = jpeg.pixel_aspect(); aspect > 0) {
    set_pixel_aspect(turned.swaps() ? 1 / aspect : aspect, image);
  }
  Signal signal = signal_of_jpeg(*segments, jpeg.components(), image.notes);
  const SignalDecoder decoder(std::move(signal), choice);
  decoder.describe(8, image);
  ASSIGN_OR_RETURN(const std::optional<GainMap> map,
                   gain_map_of(file.path(), all, *segments, jpeg, limits, choice, image));
  if (map) map->describe(image);

  const uint32_t rows = jpeg.begin_rows() ? read_jpeg_rows(jpeg, decoder, map, turned, image) : 0;
  if (rows == jpeg.height() && !jpeg.is_damaged()) return image;
  const absl::Status status = damaged(file.path(), kWhat, jpeg.error());
  if (jpeg.whole_rows() == 0) return status;
  if (!choice.fills_gaps) return or_fill(status);
  if (rows == jpeg.height()) {
    image.notes.push_back(absl::StrCat(absl::StripPrefix(status.message(), file.path() + ": "),
                                       "; detail or colour of later scans is missing"));
    return image;
  }
  note_missing(file.path(), status, uint64_t{jpeg.height() - rows} * jpeg.width(), image);
  return image;
}

}  // namespace candela
