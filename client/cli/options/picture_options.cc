#include "client/cli/options/picture_options.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/base/failure.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/settings_options.h"
#include "client/color/view_table.h"
#include "client/image/color.h"
#include "client/image/read_formats.h"
#include "client/image/write/encodings.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"
#include "server/encode/color_words.h"
#include "server/encode/image_file.h"

namespace candela {
namespace {

bool is_manual(const v1::Settings& settings) {
  return settings.exposure().mode() == v1::Exposure::MODE_MANUAL;
}

absl::Status conflict(const std::string& one, const std::string& other) {
  return usage_error(
      absl::StrFormat("%s and %s both decide the exposure; give only one of them", one, other));
}

}  // namespace

void add_previous_options(CLI::App& app, v1::ExposureState& previous) {
  add_text(
      app, kExposureSection, "--previous-exposure", "FACTOR",
      absl::StrFormat(
          "Exposure of the previous frame, to adapt from; %s (default: none, the frame takes its target)",
          format_range(v1::kExposureLimit)),
      [&previous](const std::string& text) {
        const absl::StatusOr<double> x = parse_number("--previous-exposure", text, v1::kExposureLimit);
        if (x.ok()) previous.set_exposure(*x);
        return x.status();
      });
  add_number(app, kExposureSection, "--elapsed", "SECONDS", v1::kElapsedSeconds, 0,
             "Media time since the previous frame",
             [&previous](double s) { previous.set_elapsed_seconds(s); });
}

void add_locked_exposure_option(CLI::App& app, std::string& file) {
  add_text(app, kExposureSection, "--locked-exposure", "FILE",
           "Expose every frame alike: by the locked exposure of this file, which --save-exposures wrote",
           file);
}

void add_given_exposure_options(CLI::App& app, StreamOptions& options) {
  add_text(
      app, kExposureSection, "--exposures", "FILE",
      "Give each frame the exposure of its number in this file, which --save-exposures wrote; so parts of "
      "a shot get the images of one run",
      options.exposures);
  add_locked_exposure_option(app, options.locked_exposure);
}

void add_state_option(CLI::App& app, const std::string& section, StreamOptions& options) {
  add_text(app, section, "--state", "FILE",
           "Continue the exposure after the last frame of this file, which --save-exposures wrote",
           options.state);
}

void add_save_exposures_option(CLI::App& app, StreamOptions& options) {
  add_text(app, kOutputSection, "--save-exposures", "FILE",
           "Write the frames' exposures, one locked exposure for all of them and the state after the last "
           "frame, as JSON; --exposures, --locked-exposure and --state read it",
           options.save_exposures);
}

absl::Status finish_previous_options(const v1::ExposureState& previous) {
  if (previous.exposure() != 0 || previous.elapsed_seconds() == 0) return absl::OkStatus();
  return usage_error("--elapsed needs --previous-exposure; give both");
}

absl::Status finish_locked_exposure(const std::string& file, const v1::Settings& settings,
                                    const v1::ExposureState& previous) {
  if (file.empty()) return absl::OkStatus();
  if (is_manual(settings)) return conflict("--locked-exposure", "--exposure");
  if (previous.exposure() != 0) return conflict("--locked-exposure", "--previous-exposure");
  return absl::OkStatus();
}

absl::Status finish_exposure_options(StreamOptions& options) {
  if (!options.exposures.empty() && !options.locked_exposure.empty()) {
    return conflict("--exposures", "--locked-exposure");
  }
  const bool each = !options.exposures.empty();
  if (!each && options.locked_exposure.empty()) return absl::OkStatus();
  const std::string name = each ? "--exposures" : "--locked-exposure";
  if (is_manual(options.settings)) return conflict(name, "--exposure");
  if (!options.state.empty()) return conflict(name, "--state");
  if (options.lookahead > 0) {
    options.notes.push_back(absl::StrFormat("--lookahead changes no exposure beside %s", name));
    options.lookahead = 0;
  }
  if (options.cut_threshold_ev > 0) {
    options.notes.push_back(absl::StrFormat("--detect-cuts changes no exposure beside %s", name));
  }
  return absl::OkStatus();
}

namespace {

// "480x270", "480x", "x270" or "50%".
absl::Status set_resize(v1::Settings& settings, const std::string& text) {
  const absl::Status wrong = usage_error(absl::StrFormat(
      "--resize is \"%s\"; it must be WIDTHxHEIGHT, WIDTHx or xHEIGHT, with sides of 1 .. %d pixels, or a "
      "percentage above 0 and at most %s, such as 50%%",
      text, v1::kMaxDimension, v1::format_number(v1::kMaxOutputPercent)));
  v1::OutputSize& size = *settings.mutable_output_size();
  size.clear_width();
  size.clear_height();
  size.clear_percent();
  if (absl::EndsWith(text, "%")) {
    double percent = 0;
    const bool good = absl::SimpleAtod(absl::StripSuffix(text, "%"), &percent) && percent > 0 &&
                      percent <= v1::kMaxOutputPercent;
    size.set_percent(percent);
    return good ? absl::OkStatus() : wrong;
  }
  const std::vector<std::string> sides = absl::StrSplit(text, absl::ByAnyChar("xX"));
  if (sides.size() != 2 || (sides[0].empty() && sides[1].empty())) return wrong;
  for (const size_t i : {0, 1}) {
    if (sides[i].empty()) continue;
    uint32_t pixels = 0;
    if (!absl::SimpleAtoi(sides[i], &pixels) || pixels < 1 || pixels > v1::kMaxDimension) return wrong;
    i == 0 ? size.set_width(pixels) : size.set_height(pixels);
  }
  return absl::OkStatus();
}

}  // namespace

void add_size_options(CLI::App& app, v1::Settings& settings, const v1::SettingField& setting) {
  const std::string& group = setting.declaration().group();
  add_text(app, group, "--resize", "WxH|Wx|xH|N%",
           absl::StrFormat(
               "%s, made in linear light, before the tone curve: both sides, one of them while the "
               "other follows from the frame's shape, or percent of both; 1 .. %d pixels, above 0 "
               ".. %s %% (default: the frame's). Exposure and bloom are the frame's",
               setting.declaration().help(), v1::kMaxDimension, v1::format_number(v1::kMaxOutputPercent)),
           [&settings](const std::string& text) { return set_resize(settings, text); });
  const v1::Range<double> range{1, double{v1::kMaxDimension}};
  add_text(
      app, group, "--max-size", "N",
      absl::StrFormat("Make the longer side N pixels, as --resize does; a frame that is no larger keeps its "
                      "pixels; %s (default: no limit)",
                      format_range(range)),
      [&settings, range](const std::string& text) {
        const absl::StatusOr<double> side = parse_number("--max-size", text, range, true);
        if (side.ok()) settings.mutable_output_size()->set_max_side(static_cast<uint32_t>(*side));
        return side.status();
      });
}

void add_desqueeze_option(CLI::App& app, PictureOptions& options) {
  app.add_flag(
         "--desqueeze", options.desqueeze,
         "Make square pixels of an anamorphic file's: its pixel aspect (of OpenEXR pixelAspectRatio) widens "
         "the image, as --resize does. Without it the image's pixels have the file's aspect, and say so")
      ->group(kOutputSection);
}

absl::Status check_size_options(const v1::Settings& settings) {
  const v1::OutputSize& size = settings.output_size();
  if (size.max_side() > 0 && (size.width() > 0 || size.height() > 0 || size.has_percent())) {
    return usage_error("--resize and --max-size both say the image's size; give only one of them");
  }
  return absl::OkStatus();
}

namespace {

constexpr char kVerification[] = "Verification";

}  // namespace

void add_verify_options(CLI::App& app, VerifyChoice& choice) {
  app.add_flag("--verify", choice.verify,
               "Compare the image with the float64 reference and report the error; takes seconds")
      ->group(kVerification);
  add_text(app, kVerification, "--error-map", "FILE.png", "Draw the error of every pixel; implies --verify",
           [&choice](const std::string& path) {
             choice.error_map = path;
             choice.verify = true;
             return absl::OkStatus();
           });
}

absl::Status check_verify_options(const VerifyChoice& choice, const std::string& output) {
  if (choice.error_map.empty()) return absl::OkStatus();
  if (const auto encoding = output_encoding(choice.error_map);
      !encoding.ok() || (*encoding)->server != v1::ENCODING_PNG) {
    return usage_error(absl::StrFormat("--error-map is %s; it must end in .png", choice.error_map));
  }
  if (choice.error_map == output) {
    return usage_error(
        absl::StrFormat("--error-map %s: OUT is the same file; give another name", choice.error_map));
  }
  return absl::OkStatus();
}

namespace {

constexpr char kVariable[] = "OCIO";  // OpenColorIO's own

// With --lut the view is that of a LUT.
absl::Status take_lut(PictureOptions& options) {
  ViewChoice& view = options.view;
  if (options.lut.empty()) {
    if (view.lut_input.empty() && !view.lut_domain) return absl::OkStatus();
    return usage_error(absl::StrFormat("%s says what a LUT takes; name one with --lut FILE",
                                       view.lut_domain ? "--lut-domain" : "--lut-input"));
  }
  for (const auto& [name, value] :
       {std::pair("--ocio", view.config), std::pair("--display", view.display),
        std::pair("--ocio-view", view.view), std::pair("--ocio-input", view.input)}) {
    if (!value.empty()) return usage_error(absl::StrFormat("--lut is a view by itself; leave out %s", name));
  }
  view.config = options.lut;
  view.source = "--lut";
  if (view.lut_input.empty()) view.lut_input = lut_inputs().front();
  return absl::OkStatus();
}

absl::Status take_domain(const std::string& text, ViewChoice& view) {
  ASSIGN_OR_RETURN(const auto values, parse_list("--lut-domain", text, 2, {-65504, 65504}));
  if (!(values[0] < values[1])) {
    return usage_error(absl::StrFormat("--lut-domain is \"%s\"; the first must be below the second", text));
  }
  view.lut_domain = std::pair(values[0], values[1]);
  return absl::OkStatus();
}

}  // namespace

void add_view_options(CLI::App& app, PictureOptions& options) {
  ViewChoice& view = options.view;
  const auto add = [&](const char* name, const char* placeholder, const char* help, std::string& to) {
    add_text(app, kToneSection, name, placeholder, help, to);
  };
  add("--ocio", "CONFIG",
      "Instead of a curve: a view of this OpenColorIO configuration, at 0 EV and without bloom unless their "
      "options are given (default: $OCIO)",
      view.config);
  add("--display", "NAME", "Display of --ocio (default: the configuration's)", view.display);
  add("--ocio-view", "NAME", "View of --ocio (default: the display's)", view.view);
  add("--ocio-input", "NAME",
      "Colour space of --ocio that the file's values are in, whatever "
      "the file says (default: light of the file's primaries)",
      view.input);
  add("--lut", "FILE",
      "Instead of a curve: this LUT (.cube, .clf, .ctf, .spi1d, .spi3d, .3dl and others), at 0 EV and "
      "without bloom unless "
      "their options are given",
      options.lut);
  add_text(app, kToneSection, "--lut-input", "NAME",
           absl::StrFormat("Values that the LUT takes: %s (default %s, of Rec.709)",
                           absl::StrJoin(lut_inputs(), ", "), lut_inputs().front()),
           [&view](const std::string& word) {
             const std::vector<std::string> words = lut_inputs();
             if (std::ranges::count(words, word) == 0) return unknown_word("--lut-input", word, words);
             view.lut_input = word;
             return absl::OkStatus();
           });
  add_text(
      app, kToneSection, "--lut-domain", "LOW,HIGH",
      "Values at the ends of a LUT whose file does not say them, such as -10,6 stops with --lut-input log2 "
      "(default: as the file says, or 0,1)",
      [&view](const std::string& text) { return take_domain(text, view); });
}

absl::Status finish_view_options(PictureOptions& options, const std::string& output, bool encoded) {
  ViewChoice& view = options.view;
  view.source = "--ocio";
  const char* variable = std::getenv(kVariable);
  const bool curve = options.settings.curve() != v1::TONE_CURVE_UNSPECIFIED;
  RETURN_IF_ERROR(take_lut(options));
  if (view.config.empty() && !curve && variable != nullptr && *variable != '\0') {
    view.config = variable;
    view.source = "$OCIO";
  }
  if (view.config.empty()) {
    for (const auto& [name, value] :
         {std::pair("--display", view.display), std::pair("--ocio-view", view.view),
          std::pair("--ocio-input", view.input)}) {
      if (!value.empty()) {
        return usage_error(
            absl::StrFormat("%s is part of an OpenColorIO configuration; name one with --ocio CONFIG", name));
      }
    }
    return absl::OkStatus();
  }
  if (curve) {
    return usage_error(absl::StrFormat("%s replaces --curve; give only one of them",
                                       view.lut_input.empty() ? "--ocio" : "--lut"));
  }
  const v1::Primaries primaries = options.settings.input_primaries();
  if (!view.input.empty() &&
      (options.settings.has_input_chromaticities() ||
       (primaries != v1::PRIMARIES_UNSPECIFIED && primaries != v1::PRIMARIES_REC709))) {
    return usage_error(absl::StrFormat(
        "--primaries and --ocio-input %s both say what the file's values are; give only one of them",
        view.input));
  }
  if (!view.input.empty()) options.settings.clear_input_primaries();
  if (!encoded) {
    options.notes.push_back(absl::StrFormat("%s holds the view's display values, not linear light", output));
  }
  options.settings.set_curve(v1::TONE_CURVE_TABLE);
  options.write.transfer = EncodedTransfer::kUnknown;
  return absl::OkStatus();
}

void choose_view_defaults(PictureOptions& options, bool exposure_given) {
  if (options.view.config.empty()) return;
  v1::Exposure& exposure = *options.settings.mutable_exposure();
  if (!exposure_given && exposure.mode() == v1::Exposure::MODE_UNSPECIFIED) {
    exposure.set_mode(v1::Exposure::MODE_MANUAL);
    exposure.set_manual_ev(0);
    options.defaults.exposure = true;
  }
  if (options.settings.bloom().ByteSizeLong() > 0) return;
  options.settings.mutable_bloom()->set_intensity(0);
  options.defaults.bloom = true;
}

namespace {

// Words of --input-transfer.
struct TransferWord {
  const char* word;
  SignalTransfer transfer;
  double gamma = 0;  // of kGamma
};
constexpr TransferWord kTransferWords[] = {
    {"linear", SignalTransfer::kLinear},
    {"srgb", SignalTransfer::kSrgb},
    {"bt709", SignalTransfer::kSrgb},
    {"gamma18", SignalTransfer::kGamma, 1.8},
    {"gamma22", SignalTransfer::kGamma, 2.2},
    {"gamma24", SignalTransfer::kGamma, 2.4},
    {"gamma26", SignalTransfer::kGamma, 2.6},
    {"gamma28", SignalTransfer::kGamma, 2.8},
    {"smpte240", SignalTransfer::kSmpte240},
    {"log100", SignalTransfer::kLog100},
    {"log316", SignalTransfer::kLog316},
    {"dci", SignalTransfer::kCinema},
    {"pq", SignalTransfer::kPq},
    {"hlg", SignalTransfer::kHlg},
};

// Words of --input-matrix, with their numbers of ITU-T H.273.
struct MatrixWord {
  const char* word;
  int code;
};
constexpr MatrixWord kMatrixWords[] = {{"bt601", 6}, {"bt709", 1}, {"bt2020", 9},  {"smpte240", 7},
                                       {"fcc", 4},   {"ycgco", 8}, {"identity", 0}};

// The row of the table with this word; or a usage error that lists them.
template <typename Row, size_t kCount>
absl::StatusOr<Row> row_of(const char* option, const Row (&rows)[kCount], const std::string& word) {
  std::vector<std::string> words;
  for (const Row& row : rows) {
    if (word == row.word) return row;
    words.emplace_back(row.word);
  }
  return unknown_word(option, word, words);
}

template <typename Row, size_t kCount>
std::string words_of_rows(const Row (&rows)[kCount]) {
  return absl::StrJoin(rows, ", ", [](std::string* to, const Row& row) { absl::StrAppend(to, row.word); });
}

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
                      "says, else srgb of PNG, AVIF, JPEG, y4m and TIFF of integers, linear of others)",
                      words_of_rows(kTransferWords)),
      [&shown](const std::string& word) {
        ASSIGN_OR_RETURN(const TransferWord row, row_of("--input-transfer", kTransferWords, word));
        shown.transfer = row.transfer;
        shown.gamma = row.gamma;
        return absl::OkStatus();
      });
  add_text(
      app, kInputSection, "--input-matrix", "NAME",
      absl::StrFormat("The matrix of an AVIF's or a y4m's luma and chroma, whatever the file says: %s "
                      "(default: as it says; of y4m bt601 below %d lines, else bt709, or bt2020 with its "
                      "primaries)",
                      words_of_rows(kMatrixWords), kHdLines),
      [&shown](const std::string& word) {
        ASSIGN_OR_RETURN(const MatrixWord row, row_of("--input-matrix", kMatrixWords, word));
        shown.matrix = row.code;
        return absl::OkStatus();
      });
  add_text(
      app, kInputSection, "--input-range", "full|limited",
      "The range of a PNG's, an AVIF's or a y4m's codes, whatever the file says: all of them, or 16 .. 235 "
      "of 8 bits",
      [&shown](const std::string& word) {
        if (word != "full" && word != "limited") {
          return unknown_word("--input-range word", word, {"full", "limited"});
        }
        shown.full_range = word == "full";
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

void add_scene_light_option(CLI::App& app, PictureOptions& options) {
  app.add_flag(
         "--scene-light", options.scene_light,
         "Take a PNG, AVIF, JPEG, TIFF or y4m as light of a scene: metered, with bloom, by a tone curve "
         "(default: "
         "as the finished picture that it is, which only an option of exposure, bloom or curve changes)")
      ->group(kInputSection);
}

void add_sdr_option(CLI::App& app, PictureOptions& options) {
  add_text(app, kToneSection, "--sdr", "base|curve",
           "The SDR image of a picture with a gain map: base, the SDR picture in the file (the default "
           "without an option "
           "of exposure, bloom or curve), or curve, what --curve makes of its HDR light",
           [&options](const std::string& word) {
             if (word != "base" && word != "curve")
               return unknown_word("--sdr word", word, {"base", "curve"});
             options.sdr = word;
             return absl::OkStatus();
           });
}

void choose_sdr(PictureOptions& options, bool exposure_given) {
  const v1::Settings& settings = options.settings;
  const bool asks_for_a_look = exposure_given ||
                               settings.exposure().mode() != v1::Exposure::MODE_UNSPECIFIED ||
                               settings.bloom().ByteSizeLong() > 0 ||
                               settings.curve() != v1::TONE_CURVE_UNSPECIFIED || options.scene_light;
  const bool shows_more_than_sdr = is_hdr(encoded_transfer(settings)) || settings.has_gain_map_peak_nits() ||
                                   settings.output_format() == v1::OUTPUT_FORMAT_RGBA16F;
  options.shown.base_of_gain_map =
      options.sdr.empty() ? !asks_for_a_look && !shows_more_than_sdr : options.sdr == "base";
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

void add_only_option(CLI::App& app, std::vector<std::string>& extensions) {
  add_text(app, kInputSection, "--only", "EXT,EXT,...",
           "Take only files with these extensions, such as exr or jpg,jpeg; what else IN names is left out",
           [&extensions](const std::string& text) {
             extensions.clear();
             for (const absl::string_view word : absl::StrSplit(absl::AsciiStrToLower(text), ',')) {
               const absl::string_view name = absl::StripPrefix(word, ".");
               if (name.empty() || !absl::c_all_of(name, absl::ascii_isalnum)) {
                 return usage_error(absl::StrFormat(
                     "--only is \"%s\"; give extensions with commas between them, such as exr,png", text));
               }
               extensions.push_back(absl::StrCat(".", name));
             }
             return absl::OkStatus();
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
  const std::string extension = extension_of(output);
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
  options.names_primaries = encoding.names_primaries();
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
