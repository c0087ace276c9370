// `candela contact`: all pictures of a shot on one sheet.
#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/render_batch.h"
#include "client/cli/json_output.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/run_display.h"
#include "client/cli/terminal.h"
#include "client/image/image.h"
#include "client/image/write/encodings.h"
#include "client/run/options.h"
#include "client/run/output_files.h"
#include "client/run/picture_run.h"
#include "client/run/run.h"
#include "client/run/sequence.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/encode/color_words.h"
#include "server/encode/image_file.h"

namespace candela {
namespace {

struct ContactOptions : RenderOptions {
  uint32_t columns = 0;  // of the sheet; 0: as many as rows
};

struct ContactArguments {
  std::vector<std::string> files;  // inputs, then the sheet
  ContactOptions options;
};

constexpr uint32_t kSheetCell = 320;  // pixels, the longer side of a picture
constexpr v1::Range<double> kSheetColumns{1, 1000};

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_contact_options(CLI::App& app, ContactArguments& arguments) {
  ContactOptions& options = arguments.options;
  app.add_option("IN... OUT", arguments.files,
                 absl::StrFormat("IN: images, folders or quoted patterns such as 'in/*.exr'. OUT: the sheet: "
                                 "%s. The longer side of its pictures is %d pixels",
                                 extensions_with(&OutputEncoding::takes_8_bits), kSheetCell))
      ->required()
      ->option_text(" ");
  add_only_option(app, options.only);
  add_choice_options(app, options);
  add_scene_light_option(app, options);
  add_sdr_option(app, options);
  add_max_pixels_option(app, options);
  add_settings_options(app, options.settings);
  add_view_options(app, options);
  add_locked_exposure_option(app, options.locked_exposure);
  add_text(app, kOutputSection, "--columns", "N",
           absl::StrFormat("Pictures in a row; %s (default: as many as there are rows)",
                           format_range(kSheetColumns)),
           [&options](const std::string& text) {
             const absl::StatusOr<double> columns = parse_number("--columns", text, kSheetColumns, true);
             if (columns.ok()) options.columns = static_cast<uint32_t>(*columns);
             return columns.status();
           });
  add_json_option(app, kOutputSection, "Write one line of JSON an image, and one for all", options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  app.add_flag("--verbose,-v", options.verbose, "Print everything about each image, not only a line")
      ->group(kOutputSection);
  add_servers_options(app, options.server);
}

// After parsing: chooses the pictures' size and refuses options that conflict.
absl::Status finish_contact_options(ContactArguments& arguments) {
  ContactOptions& options = arguments.options;
  if (arguments.files.size() < 2) {
    return usage_error("contact needs images and a sheet: candela contact 'in/*.exr' sheet.png");
  }
  options.inputs.assign(arguments.files.begin(), arguments.files.end() - 1);
  options.output = arguments.files.back();
  RETURN_IF_ERROR(check_input_names(options.inputs));
  RETURN_IF_ERROR(check_output_name(options.output));
  v1::Settings& settings = options.settings;
  if (is_hdr(encoded_transfer(settings))) {
    return usage_error(absl::StrFormat("--transfer %s: a sheet is an SDR image; leave it out",
                                       v1::word_of(settings.transfer())));
  }
  if (settings.alpha() == v1::ALPHA_UNSPECIFIED) settings.set_alpha(v1::ALPHA_OVER);
  if (!settings.has_output_size()) settings.mutable_output_size()->set_max_side(kSheetCell);
  RETURN_IF_ERROR(finish_picture_options(options, {}, options.output));
  if (settings.has_gain_map_peak_nits())
    return usage_error("--gain-map is for one picture; a sheet has none");
  if (settings.output_format() != v1::OUTPUT_FORMAT_RGBA8) {
    const bool light = settings.output_format() == v1::OUTPUT_FORMAT_RGBA16F;
    return usage_error(absl::StrFormat("%s holds %s; a sheet is a %s", options.output,
                                       light ? "light" : "more than 8 bits",
                                       extensions_with(&OutputEncoding::takes_8_bits)));
  }
  RETURN_IF_ERROR(finish_locked_exposure(options.locked_exposure, settings, options.previous));
  options.names_primaries = false;
  choose_sdr(options, !options.locked_exposure.empty());
  choose_view_defaults(options, !options.locked_exposure.empty());
  return finish_server_options(options.server);
}

// Letters for contact sheets: ASCII in 5 x 8 dots, the font 5x8 of the X Window System (font-misc-misc),
// which is in the public domain.

constexpr uint32_t kLetterWidth = 5, kLetterHeight = 8;  // dots, with the space to the next

constexpr char kFirstLetter = ' ', kLastLetter = '~';
constexpr std::array<uint8_t, kLetterWidth> kLetters[] = {
    {0x00, 0x00, 0x00, 0x00, 0x00}, {0x00, 0x00, 0x5E, 0x00, 0x00}, {0x00, 0x0E, 0x00, 0x0E, 0x00},
    {0x14, 0x7F, 0x14, 0x7F, 0x14}, {0x04, 0x2A, 0x7F, 0x2A, 0x10}, {0x00, 0x16, 0x08, 0x34, 0x00},
    {0x36, 0x49, 0x36, 0x40, 0x00}, {0x00, 0x00, 0x0E, 0x00, 0x00}, {0x00, 0x3C, 0x42, 0x00, 0x00},
    {0x00, 0x42, 0x3C, 0x00, 0x00}, {0x54, 0x38, 0x38, 0x54, 0x00}, {0x10, 0x10, 0x7C, 0x10, 0x10},
    {0x00, 0x80, 0x60, 0x20, 0x00}, {0x10, 0x10, 0x10, 0x10, 0x00}, {0x00, 0x40, 0xE0, 0x40, 0x00},
    {0x60, 0x10, 0x08, 0x06, 0x00}, {0x00, 0x3C, 0x42, 0x3C, 0x00}, {0x00, 0x44, 0x7E, 0x40, 0x00},
    {0x64, 0x52, 0x52, 0x4C, 0x00}, {0x22, 0x4A, 0x4E, 0x32, 0x00}, {0x18, 0x14, 0x7E, 0x10, 0x00},
    {0x2E, 0x4A, 0x4A, 0x32, 0x00}, {0x3C, 0x4A, 0x4A, 0x30, 0x00}, {0x02, 0x62, 0x1A, 0x06, 0x00},
    {0x34, 0x4A, 0x4A, 0x34, 0x00}, {0x0C, 0x52, 0x52, 0x3C, 0x00}, {0x00, 0x6C, 0x6C, 0x00, 0x00},
    {0x00, 0x80, 0x6C, 0x2C, 0x00}, {0x00, 0x18, 0x24, 0x42, 0x00}, {0x28, 0x28, 0x28, 0x28, 0x00},
    {0x00, 0x42, 0x24, 0x18, 0x00}, {0x00, 0x04, 0x52, 0x0C, 0x00}, {0x3C, 0x42, 0x99, 0xA5, 0x1E},
    {0x7C, 0x12, 0x12, 0x7C, 0x00}, {0x7E, 0x4A, 0x4A, 0x34, 0x00}, {0x3C, 0x42, 0x42, 0x24, 0x00},
    {0x7E, 0x42, 0x42, 0x3C, 0x00}, {0x7E, 0x4A, 0x4A, 0x42, 0x00}, {0x7E, 0x0A, 0x0A, 0x02, 0x00},
    {0x3C, 0x42, 0x52, 0x34, 0x00}, {0x7E, 0x08, 0x08, 0x7E, 0x00}, {0x00, 0x42, 0x7E, 0x42, 0x00},
    {0x20, 0x42, 0x3E, 0x02, 0x00}, {0x7E, 0x08, 0x34, 0x42, 0x00}, {0x7E, 0x40, 0x40, 0x40, 0x00},
    {0x7E, 0x0C, 0x0C, 0x7E, 0x00}, {0x7E, 0x0C, 0x38, 0x7E, 0x00}, {0x3C, 0x42, 0x42, 0x3C, 0x00},
    {0x7E, 0x12, 0x12, 0x0C, 0x00}, {0x3C, 0x52, 0x62, 0xBC, 0x00}, {0x7E, 0x12, 0x12, 0x6C, 0x00},
    {0x24, 0x4A, 0x52, 0x24, 0x00}, {0x00, 0x02, 0x7E, 0x02, 0x00}, {0x3E, 0x40, 0x40, 0x3E, 0x00},
    {0x1E, 0x60, 0x60, 0x1E, 0x00}, {0x7E, 0x30, 0x30, 0x7E, 0x00}, {0x66, 0x18, 0x18, 0x66, 0x00},
    {0x06, 0x08, 0x70, 0x08, 0x06}, {0x62, 0x52, 0x4A, 0x46, 0x00}, {0x00, 0x7E, 0x42, 0x42, 0x00},
    {0x06, 0x08, 0x10, 0x60, 0x00}, {0x00, 0x42, 0x42, 0x7E, 0x00}, {0x00, 0x04, 0x02, 0x04, 0x00},
    {0x80, 0x80, 0x80, 0x80, 0x00}, {0x00, 0x02, 0x04, 0x00, 0x00}, {0x30, 0x48, 0x48, 0x78, 0x00},
    {0x7E, 0x48, 0x48, 0x30, 0x00}, {0x00, 0x30, 0x48, 0x48, 0x00}, {0x30, 0x48, 0x48, 0x7E, 0x00},
    {0x30, 0x68, 0x58, 0x10, 0x00}, {0x10, 0x7C, 0x12, 0x04, 0x00}, {0x10, 0xA8, 0xA8, 0x70, 0x00},
    {0x7E, 0x08, 0x08, 0x70, 0x00}, {0x00, 0x48, 0x7A, 0x40, 0x00}, {0x00, 0x40, 0x80, 0x7A, 0x00},
    {0x7E, 0x10, 0x10, 0x68, 0x00}, {0x00, 0x42, 0x7E, 0x40, 0x00}, {0x78, 0x08, 0x70, 0x08, 0x70},
    {0x78, 0x08, 0x08, 0x70, 0x00}, {0x30, 0x48, 0x48, 0x30, 0x00}, {0xF8, 0x28, 0x28, 0x10, 0x00},
    {0x10, 0x28, 0x28, 0xF8, 0x00}, {0x78, 0x10, 0x08, 0x10, 0x00}, {0x00, 0x50, 0x58, 0x28, 0x00},
    {0x08, 0x3E, 0x48, 0x20, 0x00}, {0x38, 0x40, 0x40, 0x78, 0x00}, {0x00, 0x38, 0x40, 0x38, 0x00},
    {0x38, 0x40, 0x30, 0x40, 0x38}, {0x48, 0x30, 0x30, 0x48, 0x00}, {0x58, 0xA0, 0xA0, 0x78, 0x00},
    {0x48, 0x68, 0x58, 0x48, 0x00}, {0x08, 0x2A, 0x55, 0x41, 0x00}, {0x00, 0x00, 0x7E, 0x00, 0x00},
    {0x41, 0x55, 0x2A, 0x08, 0x00}, {0x04, 0x02, 0x04, 0x02, 0x00}};
static_assert(std::size(kLetters) == kLastLetter - kFirstLetter + 1);

// The columns of a letter from left to right; the lowest bit is the top dot.
const std::array<uint8_t, kLetterWidth>& letter(char c) {
  CHECK(c >= kFirstLetter && c <= kLastLetter);
  return kLetters[c - kFirstLetter];
}

// A file's name in these letters. A character that is none of them is its number in Unicode, as in "<753B>",
// so that any two names look different.
std::string in_letters(const std::string& name) {
  const std::string text = escaped(name);  // UTF-8 without control characters
  std::string letters;
  for (size_t i = 0; i < text.size(); ++i) {
    const auto first = static_cast<unsigned char>(text[i]);
    if (first < 0x80) {
      letters += text[i];
      continue;
    }
    const int more = first >= 0xf0 ? 3 : first >= 0xe0 ? 2 : 1;  // bytes of the character
    uint32_t number = first & (0x3f >> more);
    for (int k = 0; k < more; ++k) number = number << 6 | (static_cast<unsigned char>(text[++i]) & 0x3f);
    absl::StrAppendFormat(&letters, "<%X>", number);
  }
  return letters;
}

// A sheet of small pictures with words below them.

struct SheetPicture {
  Image picture;            // kRgba8; its alpha is not looked at. Without pixels: there is none
  std::string name, words;  // in letters
};

constexpr uint32_t kGap = 12, kDot = 2;  // pixels: between cells, and a letter's dot
constexpr uint32_t kTextLine = (kLetterHeight + 1) * kDot, kWords = 2 * (kTextLine + kDot);
constexpr uint32_t kLeastCell = 22 * kLetterWidth * kDot;  // "frame 1001  +12.34 EV"
constexpr uint8_t kBackground = 32, kNameInk = 224, kWordsInk = 160;

// "shot_v012.0001.exr" in 12 letters is "shot_..1.exr".
std::string cut_to(const std::string& text, size_t letters) {
  if (text.size() <= letters) return text;
  const size_t begin = (letters - 2) / 2;
  return text.substr(0, begin) + ".." + text.substr(text.size() - (letters - 2 - begin));
}

class Sheet {
 public:
  explicit Sheet(Image image) : image_(std::move(image)) {
    fill(0, 0, image_.width, image_.height, kBackground);
  }
  Image take() && { return std::move(image_); }

  void put(const Image& picture, uint32_t x, uint32_t y) {
    for (uint32_t row = 0; row < picture.height; ++row) {
      std::memcpy(at(x, y + row), picture.pixels.data() + row * picture.row_bytes(), picture.row_bytes());
    }
    for (uint32_t row = 0; row < picture.height; ++row) {
      for (uint32_t i = 0; i < picture.width; ++i) at(x + i, y + row)[3] = std::byte{255};
    }
  }

  void write(const std::string& text, uint32_t x, uint32_t y, uint8_t ink) {
    for (const char c : text) {
      for (uint32_t column = 0; column < kLetterWidth; ++column) {
        for (uint32_t row = 0; row < kLetterHeight; ++row) {
          if ((letter(c)[column] >> row & 1) != 0) fill(x + column * kDot, y + row * kDot, kDot, kDot, ink);
        }
      }
      x += kLetterWidth * kDot;
    }
  }

 private:
  std::byte* at(uint32_t x, uint32_t y) {
    return image_.pixels.data() + y * image_.row_bytes() + size_t{4} * x;
  }
  void fill(uint32_t x, uint32_t y, uint32_t width, uint32_t height, uint8_t code) {
    for (uint32_t row = y; row < y + height; ++row) {
      for (uint32_t i = x; i < x + width; ++i) {
        std::fill_n(at(i, row), 3, std::byte{code});
        at(i, row)[3] = std::byte{255};
      }
    }
  }

  Image image_;
};

// Lays the pictures, at least one, out in rows of `columns`, in cells of the largest one's size. 0: as many
// columns as rows, if the sheet may be so wide. Words that are wider than a
// cell are cut in the middle. INVALID_ARGUMENT with the sheet's size if a side would be more than
// kMaxDimension; RESOURCE_EXHAUSTED without memory.
absl::StatusOr<Image> make_contact_sheet(const std::vector<SheetPicture>& pictures, uint32_t columns) {
  uint32_t wide = kLeastCell, high = 1;
  for (const SheetPicture& one : pictures) {
    wide = std::max(wide, one.picture.width);
    high = std::max(high, one.picture.height);
  }
  if (columns == 0) {
    const auto side = static_cast<uint32_t>(std::ceil(std::sqrt(static_cast<double>(pictures.size()))));
    columns = std::min(side, std::max(1u, (v1::kMaxDimension - kGap) / (wide + kGap)));
  }
  columns = std::min(columns, static_cast<uint32_t>(pictures.size()));
  const uint64_t rows = (pictures.size() + columns - 1) / columns;
  const uint64_t width = kGap + uint64_t{columns} * (wide + kGap),
                 height = kGap + rows * (uint64_t{high} + kWords + kGap);
  if (std::max(width, height) > v1::kMaxDimension) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "a sheet of %d pictures in %d columns is %dx%d, and %d is the most; make smaller pictures, or "
        "several sheets",
        pictures.size(), columns, width, height, v1::kMaxDimension));
  }
  ASSIGN_OR_RETURN(Image image, image_to_overwrite(static_cast<uint32_t>(width),
                                                   static_cast<uint32_t>(height), ImageFormat::kRgba8));
  Sheet sheet(std::move(image));
  const size_t letters = wide / (kLetterWidth * kDot);
  for (size_t i = 0; i < pictures.size(); ++i) {
    const auto x = static_cast<uint32_t>(kGap + i % columns * (wide + kGap));
    const auto y = static_cast<uint32_t>(kGap + i / columns * (high + kWords + kGap));
    const SheetPicture& one = pictures[i];
    sheet.put(one.picture, x + (wide - one.picture.width) / 2, y + high - one.picture.height);
    sheet.write(cut_to(one.name, letters), x, y + high + 2 * kDot, kNameInk);
    sheet.write(cut_to(one.words, letters), x, y + high + 2 * kDot + kTextLine, kWordsInk);
  }
  return std::move(sheet).take();
}

// "frame 7  +1.23 EV"; without a number at the end of the name, after a dot, a line or a dash, only the
// exposure.
std::string words_below(const std::string& input, const RenderReport& report) {
  const std::string stem = std::filesystem::path(input).stem().string();
  const size_t begin = stem.find_last_not_of("0123456789") + 1;  // 0 if all are digits
  const bool apart = begin == 0 || absl::StrContains("._-", stem.substr(begin - 1, 1));
  std::string words = apart && begin < stem.size() && stem.size() - begin < 10
                          ? absl::StrFormat("frame %d  ", std::atoll(stem.c_str() + begin))
                          : "";
  return words + with_sign(std::log2(report.header.exposure()), 2) + " EV";
}

absl::Status run_contact(const ContactOptions& options, JsonOutput& json) {
  ASSIGN_OR_RETURN(const FoundFiles files, files_of_inputs(options.inputs, options.only, options.output));
  std::vector<RenderJob> jobs;
  for (const std::string& path : files.paths) jobs.push_back({path, options.output});
  std::vector<std::string> inputs = files_of(options.server);
  inputs.insert(inputs.end(), {options.view.config, options.locked_exposure});
  inputs.insert(inputs.end(), files.paths.begin(), files.paths.end());
  RETURN_IF_ERROR(check_outputs_apart(inputs, {{options.output, "the sheet"}, {options.json, "the JSON"}}));
  RETURN_IF_ERROR(make_folder_of(options.output));
  if (const auto kind = check_output_path(options.output); !kind.ok()) return kind.status();
  RETURN_IF_ERROR(json.open());
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  if (!options.quiet) print_left_out(files.left_out);
  RunDisplay display(options.quiet, json, progress);
  Run run(options, display);
  RETURN_IF_ERROR(run.read_exposure());
  RETURN_IF_ERROR(run.bake());

  std::vector<SheetPicture> pictures(jobs.size());
  for (size_t i = 0; i < jobs.size(); ++i) {
    pictures[i].name = in_letters(std::filesystem::path(jobs[i].input).filename().string());
    pictures[i].words = "failed";
    jobs[i].take = [&picture = pictures[i].picture](Image image) { picture = std::move(image); };
  }
  const auto render = [&](const RenderJob& job) {
    RunEvents silent;
    absl::StatusOr<RenderReport> report = run_frame(options, job, /*only=*/false, run, silent);
    if (report.ok()) pictures[&job - jobs.data()].words = words_below(job.input, *report);
    return report;
  };
  const auto write_sheet = [&]() -> absl::Status {
    ASSIGN_OR_RETURN(const Image sheet, make_contact_sheet(pictures, options.columns));
    return write_image(options.output, sheet, options.write).status();
  };
  return render_batch(
      options, jobs, render, [&run] { return run.failure(); }, json, progress, write_sheet);
}

constexpr char kContactExamples[] =
    "Examples:\n"
    "  candela contact 'shot/*.exr' sheet.png\n"
    "  candela contact library/ sheet.jpg --columns 8 --exposure 0";

Finish define_contact(CLI::App& app) {
  const auto arguments = std::make_shared<ContactArguments>();
  add_contact_options(app, *arguments);
  return [arguments](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_contact_options(*arguments));
    ContactOptions& options = arguments->options;
    add_idle_notes(
        options,
        {.given = given, .encoding = encoding_of(options.output), .view = !options.view.config.empty()});
    return parsed_command(options, run_contact);
  };
}

}  // namespace

const Command kContactCommand{"contact", "Puts many images onto one sheet, with names and exposures.",
                              kContactExamples, define_contact};

}  // namespace candela
