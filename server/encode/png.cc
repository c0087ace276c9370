#include <png.h>

#include <csetjmp>
#include <cstdio>
#include <span>

#include "absl/strings/str_cat.h"
#include "server/encode/color_words.h"
#include "server/encode/picture.h"
#include "server/encode/png_pixels.h"

namespace candela {
namespace {

struct PngFailure {
  char text[200] = "";
};

[[noreturn]] void on_error(png_structp png, png_const_charp message) {
  auto* failure = static_cast<PngFailure*>(png_get_error_ptr(png));
  std::snprintf(failure->text, sizeof failure->text, "%s", message);
  png_longjmp(png, 1);
}

void on_write(png_structp png, png_bytep bytes, size_t count) {
  const char* failure = send_to(*static_cast<ByteSink*>(png_get_io_ptr(png)), bytes, count);
  if (failure != nullptr) png_error(png, failure);
}

void on_flush(png_structp) {}

void on_warning(png_structp, png_const_charp) {}

void write_chunk(png_structp png, const char* kind, std::span<const png_byte> bytes) {
  png_write_chunk(png, reinterpret_cast<png_const_bytep>(kind), bytes.data(), bytes.size());
}

// What an HDR picture says of itself. This libpng does not know the chunks. They are those of PNG, third
// edition (W3C, 2025): sections "cICP", "mDCV", whose primaries stand in the order R, G, B, and "cLLI".
void write_hdr_chunks(png_structp png, EncodedTransfer transfer, const HdrDisplay& hdr) {
  const CodePoints code = code_points(transfer, hdr);
  const png_byte cicp[] = {code.primaries, code.transfer, 0, 1};  // R, G and B in the full range
  write_chunk(png, "cICP", cicp);

  const DisplayPoints points = display_points(hdr);
  png_byte mdcv[24] = {};  // the least luminance is 0
  png_byte* at = mdcv;
  for (const DisplayPoint& point : {points.red, points.green, points.blue, points.white}) {
    png_save_uint_16(at, point[0]);
    png_save_uint_16(at + 2, point[1]);
    at += 4;
  }
  png_save_uint_32(at, luminance_units(hdr.peak_nits));
  write_chunk(png, "mDCV", mdcv);

  if (!(hdr.max_light_nits > 0)) return;
  png_byte clli[8];
  png_save_uint_32(clli, luminance_units(hdr.max_light_nits));
  png_save_uint_32(clli + 4, luminance_units(hdr.mean_light_nits));
  write_chunk(png, "cLLI", clli);
}

// The file up to the pixels. False on failure. It has no locals with destructors, because libpng leaves it by
// longjmp.
bool write_head(png_structp png, png_infop info, ByteSink& sink, const PictureView& picture,
                const PngOptions& options, std::span<const png_text> text) {
  const EncodedTransfer transfer = options.transfer;
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_write_fn(png, &sink, on_write, on_flush);
  png_set_IHDR(png, info, picture.width, picture.height, picture.wide ? 16 : 8,
               options.alpha ? PNG_COLOR_TYPE_RGBA : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  if (transfer == EncodedTransfer::kSrgb) {
    png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
  } else if (!is_hdr(transfer) && transfer != EncodedTransfer::kUnknown) {
    png_set_gAMA(png, info, transfer == EncodedTransfer::kGamma22 ? 1 / 2.2 : 1.0);
    png_set_cHRM(png, info, 0.3127, 0.3290, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06);  // Rec.709, D65
  }
  if (picture.aspect_width != picture.aspect_height) {
    // Pixels per unit. Wider pixels mean fewer of them.
    png_set_pHYs(png, info, picture.aspect_height, picture.aspect_width, PNG_RESOLUTION_UNKNOWN);
  }
  if (!text.empty()) png_set_text(png, info, text.data(), static_cast<int>(text.size()));
  png_write_info(png, info);
  if (is_hdr(transfer)) write_hdr_chunks(png, transfer, options.hdr);
  return true;
}

// libpng's png_write_end() would miss the pixels, which it did not write.
bool write_end(png_structp png) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_chunk(png, reinterpret_cast<png_const_bytep>("IEND"), nullptr, 0);
  return true;
}

// The chunks point into the options.
std::vector<png_text> text_chunks(const PngOptions& options) {
  std::vector<png_text> chunks;
  for (const auto& [keyword, text] : options.text) {
    png_text chunk{};
    chunk.compression = PNG_TEXT_COMPRESSION_NONE;
    chunk.key = const_cast<char*>(keyword.c_str());  // libpng only reads them
    chunk.text = const_cast<char*>(text.c_str());
    chunk.text_length = text.size();
    chunks.push_back(chunk);
  }
  return chunks;
}

}  // namespace

absl::Status encode_png(const PictureView& picture, const PngOptions& options, ByteSink sink) {
  PngFailure failure;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &failure, on_error, on_warning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  const std::vector<png_text> text = text_chunks(options);
  absl::Status pixels;
  const bool written = info != nullptr && write_head(png, info, sink, picture, options, text) &&
                       (pixels = write_png_pixels(picture, options.alpha, options.threads, sink)).ok() &&
                       write_end(png);
  png_destroy_write_struct(&png, &info);
  if (written) return absl::OkStatus();
  return absl::InternalError(absl::StrCat("cannot encode the PNG: ", !pixels.ok()      ? pixels.message()
                                                                     : failure.text[0] ? failure.text
                                                                                       : "no memory"));
}

}  // namespace candela
