#include "client/cli/options/picture/picture_options.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/picture/view_options.h"
#include "client/cli/options/words/option_kinds.h"
#include "client/image/encodings.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"
#include "server/encode/color_words.h"
#include "server/encode/image_file.h"

namespace candela {
namespace {

// In the order of SignalTransfer.
const std::array<std::string, 5> kTransferWords = {"linear", "srgb", "gamma22", "pq", "hlg"};
constexpr v1::Range<double> kChunkMib{1, 65536};
constexpr v1::Range<double> kMaxPixels{1, double{v1::kMaxDimension} * v1::kMaxDimension};
constexpr v1::Range<double> kJpegQuality{v1::kJpegQuality.min, v1::kJpegQuality.max};

// The alpha of the settings, if the user chose none. The server's default is for the other files.
void choose_alpha(PictureOptions& options, const OutputEncoding& encoding, const std::string& output) {
  const v1::Alpha given = options.settings.alpha();
  options.ignore_empty_alpha =
      encoding.holds_codes() &&
      (given == v1::ALPHA_UNSPECIFIED || (given == v1::ALPHA_ASSOCIATED && encoding.has_alpha()));
  if (given == v1::ALPHA_UNSPECIFIED && encoding.alpha == v1::ALPHA_STRAIGHT) {
    options.settings.set_alpha(v1::ALPHA_STRAIGHT);
  }
  if (given == v1::ALPHA_STRAIGHT && !encoding.has_alpha()) {
    options.notes.push_back(absl::StrFormat(
        "--alpha straight: %s has no alpha, so soft edges are hard; --alpha over has a background", output));
  }
}

}  // namespace

void add_choice_options(CLI::App& app, PictureOptions& options) {
  PictureChoice& shown = options.shown;
  add_text(app, kInputSection, "--part", "N|NAME",
           "Part of a multi-part OpenEXR file, by number from 1 or by name (default: the one whose name says "
           "that it is the picture, such as rgba or beauty, else the first with colour)",
           shown.part);
  add_text(app, kInputSection, "--layer", "NAME",
           "Layer of an OpenEXR file, NAME of its channels NAME.R ..., or one "
           "channel by its full name, as grey; RGB for the channels without "
           "a layer, XYZ for X, Y and Z as CIE XYZ (default: as for --part)",
           shown.layer);
  add_text(app, kInputSection, "--exr-view", "NAME", "View of a multi-view OpenEXR file, such as left",
           shown.view);
  add_text(app, kInputSection, "--incomplete", "error|fill",
           "What an unfinished or damaged file is: an error (default), or the pixels that there are, and the "
           "others absent, with alpha 0",
           [&shown](const std::string& word) {
             if (word != "error" && word != "fill")
               return unknown_word("--incomplete word", word, {"error", "fill"});
             shown.fills_gaps = word == "fill";
             return absl::OkStatus();
           });
  add_text(app, kInputSection, "--rows", "top|bottom",
           "Which row of a PFM or PHM image comes first (default: the lowest of a PFM, the top one of a PHM; "
           "ffmpeg writes both from the top)",
           [&shown](const std::string& word) {
             if (word != "top" && word != "bottom")
               return unknown_word("--rows word", word, {"top", "bottom"});
             shown.rows = word == "top" ? RowOrder::kTop : RowOrder::kBottom;
             return absl::OkStatus();
           });
  add_text(
      app, kInputSection, "--input-transfer", "NAME",
      absl::StrFormat("How the image's values stand for light, whatever the file says: %s (default: as it "
                      "says, else srgb of PNG, AVIF, JPEG and y4m, linear of others)",
                      absl::StrJoin(kTransferWords, ", ")),
      [&shown](const std::string& word) {
        const auto found = std::ranges::find(kTransferWords, word);
        if (found == kTransferWords.end()) {
          return unknown_word("--input-transfer", word, {kTransferWords.begin(), kTransferWords.end()});
        }
        shown.transfer = static_cast<SignalTransfer>(found - kTransferWords.begin());
        return absl::OkStatus();
      });
  add_number(app, kInputSection, "--hlg-peak", "NIT", {400, 2000}, 1000,
             "Display that an HLG image is meant for", [&shown](double nits) { shown.hlg_peak = nits; });
  add_text(
      app, kInputSection, "--max-chunk-mib", "N",
      absl::StrFormat("Most MiB that one chunk of an OpenEXR file, some rows or a tile of all channels, may "
                      "take in memory; %s (default: an eighth of the memory that this process may use)",
                      format_range(kChunkMib)),
      [&options](const std::string& text) {
        const absl::StatusOr<double> mib = parse_number("--max-chunk-mib", text, kChunkMib, true);
        if (mib.ok()) options.max_chunk_mib = static_cast<uint64_t>(*mib);
        return mib.status();
      });
}

void add_max_pixels_option(CLI::App& app, PictureOptions& options) {
  add_text(app, kInputSection, "--max-pixels", "N",
           absl::StrFormat("Refuse an image of more pixels by its header, before it is decoded; %s (default: "
                           "as many as the server takes)",
                           format_range(kMaxPixels)),
           [&options](const std::string& text) {
             const absl::StatusOr<double> pixels = parse_number("--max-pixels", text, kMaxPixels, true);
             if (pixels.ok()) options.max_pixels = static_cast<uint64_t>(*pixels);
             return pixels.status();
           });
}

void add_image_options(CLI::App& app, PictureArguments& arguments, bool with_film) {
  const std::string bits = absl::StrFormat("Bits per component of a %s%s (default 8)",
                                           extensions_with(&OutputEncoding::has_16_bits),
                                           with_film ? "; 8 or 10 of y4m and films, 8 or 16 of PAM" : "");
  add_text(app, kOutputSection, "--bits", with_film ? "8|10|16" : "8|16", bits,
           [&arguments, with_film](const std::string& text) {
             if (text != "8" && text != "16" && !(with_film && text == "10")) {
               return usage_error(absl::StrFormat("--bits is \"%s\"; it must be %s", text,
                                                  with_film ? "8, 10 or 16" : "8 or 16"));
             }
             arguments.bits = text == "8" ? 8 : text == "10" ? 10 : 16;
             return absl::OkStatus();
           });
  add_number(
      app, kOutputSection, "--quality", "N", kJpegQuality, WriteOptions().jpeg_quality,
      "Quality of a " + extensions_with(&OutputEncoding::has_quality),
      [&arguments](double n) { arguments.quality = static_cast<int>(n); }, true);
}

absl::Status check_input_names(const std::vector<std::string>& inputs, bool stdin_too) {
  for (const std::string& input : inputs) {
    if (input != "-" || (stdin_too && inputs.size() == 1)) continue;
    if (stdin_too) {
      return usage_error(
          "IN is \"-\" beside others; standard input comes alone, and ./- is a file of that name");
    }
    return usage_error(
        "IN is \"-\", but images cannot be read from a pipe; give a file, or ./- for a file of that name");
  }
  return absl::OkStatus();
}

absl::Status check_output_name(const std::string& output, bool stdout_too, bool film_too) {
  if (output.empty()) return usage_error("OUT is empty; give a file");
  if (stdout_too && output == "-") return absl::OkStatus();
  for (const absl::string_view pipe : {"-", "/dev/stdout", "/dev/stderr", "/dev/fd/", "/proc/self/fd/"}) {
    if (output != pipe && !(absl::EndsWith(pipe, "fd/") && absl::StartsWith(output, pipe))) continue;
    return usage_error(absl::StrFormat("OUT is \"%s\", but images cannot be written to a pipe; give a file%s",
                                       output,
                                       output == "-" ? ", or ./- for a file or folder of that name"
                                       : stdout_too  ? ", or - for standard output"
                                                     : ""));
  }
  const std::string extension = absl::AsciiStrToLower(std::filesystem::path(output).extension().string());
  for (const char* video : {".mp4", ".m4v", ".mov", ".mkv", ".avi", ".webm", ".mxf", ".mpg"}) {
    if (extension != video || (film_too && !film_extension(output).empty())) continue;
    return usage_error(
        film_too
            ? absl::StrFormat("OUT is %s, a film of a kind that candela does not make; write a %s", output,
                              film_extensions())
            : absl::StrFormat("OUT is %s, a film, which only candela stream makes; write out/%%04d.png, and "
                              "make a film of them with ffmpeg -i out/%%04d.png %s",
                              output, output));
  }
  if (!absl::StartsWith(output, "-")) return absl::OkStatus();
  return usage_error(absl::StrFormat("OUT is \"%s\", which looks like an option; write ./%s if it is a name",
                                     output, output));
}

absl::Status finish_picture_options(PictureOptions& options, const PictureArguments& arguments,
                                    const std::string& output) {
  const absl::StatusOr<const OutputEncoding*> found = output_encoding(output);
  if (!found.ok()) return usage_error(std::string(found.status().message()));
  return finish_picture_options(options, arguments, output, **found);
}

namespace {

// An image for an HDR display has 16 bits on the wire, and its file names its transfer.
absl::Status check_hdr_output(const std::string& transfer, int bits, const std::string& output,
                              const OutputEncoding& encoding) {
  if (!encoding.has_hdr()) {
    return usage_error(absl::StrFormat("--transfer %s: %s has no word for it; write %s", transfer, output,
                                       extensions_with(&OutputEncoding::has_hdr)));
  }
  if (bits == 8) {
    return usage_error(
        absl::StrFormat("--bits 8: --transfer %s would show bands with 8 bits; leave it out", transfer));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status finish_picture_options(PictureOptions& options, const PictureArguments& arguments,
                                    const std::string& output, const OutputEncoding& encoding) {
  if (options.settings.has_gain_map_peak_nits() && encoding.server != v1::ENCODING_JPEG) {
    return usage_error(absl::StrFormat("--gain-map is for .jpg; %s has no gain map", output));
  }
  const bool hdr = is_hdr(encoded_transfer(options.settings));
  if (hdr) {
    RETURN_IF_ERROR(
        check_hdr_output(v1::word_of(options.settings.transfer()), arguments.bits, output, encoding));
  }
  if (arguments.bits == 10 && !encoding.needs_16_bits()) {
    return usage_error(absl::StrFormat("--bits 10 is for y4m and films; %s has another depth", output));
  }
  if (arguments.bits == 16 && !encoding.has_16_bits()) {
    return usage_error(absl::StrFormat("--bits 16 is for %s; %s has its own depth",
                                       extensions_with(&OutputEncoding::has_16_bits), output));
  }
  if (arguments.quality != 0 && !encoding.has_quality()) {
    return usage_error(absl::StrFormat("--quality is for %s; %s loses nothing",
                                       extensions_with(&OutputEncoding::has_quality), output));
  }
  options.settings.set_output_format(encoding.holds_light() ? v1::OUTPUT_FORMAT_RGBA16F
                                     : hdr || arguments.bits == 16 || encoding.needs_16_bits()
                                         ? v1::OUTPUT_FORMAT_RGBA16
                                         : v1::OUTPUT_FORMAT_RGBA8);
  choose_alpha(options, encoding, output);
  options.write.associated_alpha = options.settings.alpha() == v1::ALPHA_ASSOCIATED;
  options.write.transfer = encoded_transfer(options.settings);
  options.write.hdr = hdr_display(options.settings, 0, 0);
  if (arguments.quality != 0) options.write.jpeg_quality = arguments.quality;
  RETURN_IF_ERROR(finish_view_options(options, output, encoding.holds_codes()));
  return check_settings_options(options.settings);
}

absl::Status check_server_encoding(v1::Encoding encoding, const std::string& file,
                                   const std::string& output) {
  const OutputEncoding& made = output_encoding(encoding);
  const auto named = output_encoding(file);
  if (made.server != encoding || !named.ok() || *named == &made) return absl::OkStatus();
  return usage_error(
      absl::StrFormat("--encoding makes %s files, but %s is not one; change one of them", made.name, output));
}

absl::Status parse_size(const std::string& text, uint32_t& width, uint32_t& height) {
  const std::vector<std::string> parts = absl::StrSplit(text, absl::ByAnyChar("xX"));
  uint32_t w = 0, h = 0;
  const auto fits = [](uint32_t pixels) { return pixels >= 1 && pixels <= v1::kMaxDimension; };
  if (parts.size() != 2 || !absl::SimpleAtoi(parts[0], &w) || !absl::SimpleAtoi(parts[1], &h) || !fits(w) ||
      !fits(h)) {
    return usage_error(absl::StrFormat("--size is \"%s\"; it must be WIDTHxHEIGHT, 1x1 .. %dx%d", text,
                                       v1::kMaxDimension, v1::kMaxDimension));
  }
  width = w;
  height = h;
  return absl::OkStatus();
}

void add_rotation_option(CLI::App& app, const std::string& section, double& degrees) {
  add_number(app, section, "--rotation", "DEG", v1::kRotationDeg, 0,
             "Turn the panorama about the vertical; 90 moves what was ahead to the left",
             [&degrees](double value) { degrees = value; });
}

}  // namespace candela
