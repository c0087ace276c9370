// `candela stream`: a sequence of frames, whose exposure adapts.
#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <cstdio>
#include <iterator>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/base/failure.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/json_output.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/session_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/run_display.h"
#include "client/cli/stream_report.h"
#include "client/cli/terminal.h"
#include "client/image/write/atomic_file.h"
#include "client/image/write/encodings.h"
#include "client/run/exposure_file.h"
#include "client/run/options.h"
#include "client/run/output_files.h"
#include "client/run/sequence.h"
#include "client/run/sequence_run.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// The options as parsed, before they are combined and checked.
struct StreamArguments {
  std::vector<std::string> files;  // inputs, then the output
  StreamOptions options;
  PictureArguments picture;
  std::string pipe;    // --pipe, "" if not given
  std::string matrix;  // --pipe-matrix, "" if not given
  std::string codec;   // --codec, "" if not given
};

constexpr v1::Range<double> kFirst{-1e9, 1e9};

struct PipeWord {
  const char* word;
  PipeKind kind;
};
constexpr PipeWord kPipes[] = {
    {"y4m", PipeKind::kY4m420}, {"y4m444", PipeKind::kY4m444}, {"pam", PipeKind::kPam}};

struct PipeMatrix {
  const char* word;
  LumaMatrix matrix;
};
constexpr PipeMatrix kPipeMatrices[] = {
    {"bt601", kRec601Luma}, {"bt709", kRec709Luma}, {"bt2020", kRec2020Luma}};

absl::Status check_film(const StreamArguments& arguments, PipeKind kind) {
  if (kind == PipeKind::kPam) return usage_error("--pipe pam is for standard output; a film is of y4m");
  if (arguments.picture.quality == 0) return absl::OkStatus();
  return usage_error(absl::StrFormat("--quality is for %s; -v tells a film's command line, which has its own",
                                     extensions_with(&OutputEncoding::has_quality)));
}

// Chooses the format of the pipe, and of the film that ffmpeg makes of it. The picture's options are
// finished.
absl::Status choose_formats(StreamArguments& arguments, PipeKind kind, bool film) {
  StreamOptions& options = arguments.options;
  const int bits = arguments.picture.bits;
  options.pipe = pipe_format(kind, bits, options.write.transfer, options.write.hdr);
  if (!arguments.matrix.empty()) {
    if (film || kind == PipeKind::kPam) {
      return usage_error(absl::StrFormat("--pipe-matrix is for y4m on standard output; %s; leave it out",
                                         film ? "a film names its matrix" : "PAM has none"));
    }
    const auto* const found = std::ranges::find(kPipeMatrices, arguments.matrix, &PipeMatrix::word);
    if (found == std::end(kPipeMatrices)) {
      return unknown_word("--pipe-matrix word", arguments.matrix, {"bt601", "bt709", "bt2020"});
    }
    options.pipe->matrix = found->matrix;
  }
  if (!film) return absl::OkStatus();
  ASSIGN_OR_RETURN(options.film, film_format(options.output, arguments.codec, kind == PipeKind::kY4m444,
                                             options.pipe->bits == 10 ? 10 : bits));
  options.pipe = piped_for(*options.film, *options.pipe);
  return absl::OkStatus();
}

// What goes to standard output or into a film.
absl::Status finish_pipe(StreamArguments& arguments) {
  StreamOptions& options = arguments.options;
  const bool film = !film_extension(options.output).empty();
  if (!film && !arguments.codec.empty()) {
    return usage_error(absl::StrFormat("--codec %s is for films; %s is none: write a %s", arguments.codec,
                                       options.output, film_extensions()));
  }
  if (!film && options.output != "-" && options.verbose)
    options.notes.emplace_back("-v changes nothing: it is about films and pipes");
  if (options.output != "-" && !film) {
    for (const auto& [name, word] :
         {std::pair("--pipe", arguments.pipe), {"--pipe-matrix", arguments.matrix}}) {
      if (word.empty()) continue;
      return usage_error(absl::StrFormat("%s %s is for standard output; %s is none: write - as OUT", name,
                                         word, options.output));
    }
    return absl::OkStatus();
  }
  if (options.encoding != v1::ENCODING_RAW) {
    return usage_error(absl::StrFormat("--encoding is for images; OUT is \"%s\", where --%s chooses",
                                       options.output, film ? "codec" : "pipe"));
  }
  if (options.first) options.notes.emplace_back("--first changes nothing: these frames have no numbers");
  PipeKind kind = PipeKind::kY4m420;
  if (!arguments.pipe.empty()) {
    std::vector<std::string> words;
    for (const PipeWord& known : kPipes) words.emplace_back(known.word);
    const auto* const found = std::ranges::find(kPipes, arguments.pipe, &PipeWord::word);
    if (found == std::end(kPipes)) return unknown_word("--pipe word", arguments.pipe, words);
    kind = found->kind;
  }
  if (film) {
    RETURN_IF_ERROR(check_film(arguments, kind));
  }
  const OutputEncoding& encoding = piped_encoding(kind);
  RETURN_IF_ERROR(finish_picture_options(options, arguments.picture, encoding.name, encoding));
  return choose_formats(arguments, kind, film);
}

// What goes to files.
absl::Status finish_files(StreamArguments& arguments) {
  StreamOptions& options = arguments.options;
  const absl::StatusOr<OutputNames> names =
      OutputNames::parse(options.output, output_encoding(options.encoding).extension());
  if (!names.ok()) return names.status();
  if (names->is_folder() && options.first && !options.from_stdin()) {
    options.notes.push_back(
        "--first changes nothing: the images in a folder have the names of their frames; "
        "give a pattern such as out/%04d.png to number them");
  }
  const std::string sample = names->is_folder() ? options.output + "/*" + names->extension() : options.output;
  if (absl::Status status = finish_picture_options(options, arguments.picture, sample); !status.ok()) {
    return status;
  }
  return check_server_encoding(options.encoding, sample, options.output);
}

// The options that choose among files.
absl::Status check_stdin_options(const StreamOptions& options) {
  if (!options.from_stdin()) return absl::OkStatus();
  if (!options.sequence.range.empty()) {
    return usage_error("--range chooses among files; IN is \"-\", of which every frame is taken");
  }
  if (!options.sequence.only.empty()) return usage_error("--only chooses among files; IN is \"-\"");
  if (options.sequence.missing != MissingFrames::kError) {
    return usage_error("--missing is about numbers of files; IN is \"-\", where no frame is missing");
  }
  return absl::OkStatus();
}

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_stream_options(CLI::App& app, StreamArguments& arguments) {
  StreamOptions& options = arguments.options;
  app.add_option(
         "IN... OUT", arguments.files,
         absl::StrFormat(
             "IN: frames with a number in their names: a folder, files, 'in/*.exr', in/%%04d.exr or "
             "in/####.exr. OUT: a pattern for the frame's number, out/%%04d.png (%s), or a folder for .png, "
             "which keeps the names, or a film that ffmpeg makes, review.mp4 (%s). Either may be -: standard "
             "input takes PFM, PHM, PNG or OpenEXR files one after another, or y4m, standard output gets y4m "
             "or PAM",
             extensions_with(), film_extensions()))
      ->required()
      ->option_text(" ");
  add_session_options(app, options);
  add_choice_options(app, options);
  add_scene_light_option(app, options);
  add_sdr_option(app, options);
  add_max_pixels_option(app, options);
  add_settings_options(app, options.settings);
  add_desqueeze_option(app, options);
  add_given_exposure_options(app, options);
  add_view_options(app, options);
  add_image_options(app, arguments.picture, /*with_film=*/true);
  add_text(
      app, kOutputSection, "--pipe", "y4m|y4m444|pam",
      "What standard output gets: y4m of limited range, with chroma of 4:2:0 (y4m, the default) or 4:4:4; or "
      "PAM (ffmpeg -f pam_pipe -i -). What a film is made from: y4m, which needs even sizes, or y4m444",
      arguments.pipe);
  add_text(app, kOutputSection, "--pipe-matrix", "bt601|bt709|bt2020",
           absl::StrFormat("The matrix of y4m on standard output (default: bt601 below %d lines, as readers "
                           "assume it, else bt709; pq and hlg: that of their primaries)",
                           kHdLines),
           arguments.matrix);
  add_text(app, kOutputSection, "--codec", absl::StrJoin(film_codecs(), "|"),
           "Codec of a film (default h264; av1 in .webm): libx264 medium, crf 18; libx265 medium, crf 20; "
           "libaom-av1 at speed 6, crf 24; or ProRes of 10 bits, 422 HQ, with --pipe y4m444 4444",
           arguments.codec);
  add_encoding_option(app, kOutputSection, options.encoding,
                      "Who encodes the files: this command (raw) or the server (png, jpeg)");
  add_text(
      app, kOutputSection, "--first", "N",
      absl::StrFormat("Number the images N, N + 1, ... in OUT's pattern; %s (default: each image has its "
                      "frame's number)",
                      format_range(kFirst)),
      [&options](const std::string& text) {
        const absl::StatusOr<double> first = parse_number("--first", text, kFirst, true);
        if (first.ok()) options.first = static_cast<int64_t>(*first);
        return first.status();
      });
  add_curve_options(app, options);
  add_json_option(app, kOutputSection, "Write one line of JSON a frame, and one for the whole session",
                  options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  app.add_flag("--verbose,-v", options.verbose,
               "Print the command line that a film's ffmpeg is started with, and the matrix of a y4m")
      ->group(kOutputSection);
  add_session_server_options(app, options);
}

// After parsing: refuses options that conflict.
absl::Status finish_stream_options(StreamArguments& arguments) {
  StreamOptions& options = arguments.options;
  if (arguments.files.size() < 2) {
    return usage_error("stream needs input frames and an output: candela stream 'in/*.exr' out/%04d.png");
  }
  options.sequence.inputs.assign(arguments.files.begin(), arguments.files.end() - 1);
  options.output = arguments.files.back();
  RETURN_IF_ERROR(check_input_names(options.sequence.inputs, /*stdin_too=*/true));
  RETURN_IF_ERROR(check_output_name(options.output, /*stdout_too=*/true, /*film_too=*/true));
  RETURN_IF_ERROR(check_stdin_options(options));
  RETURN_IF_ERROR(finish_pipe(arguments));
  if (!options.pipe) {
    RETURN_IF_ERROR(finish_files(arguments));
  }
  options.names_primaries &= options.encoding == v1::ENCODING_RAW;
  RETURN_IF_ERROR(finish_exposure_options(options));
  const bool exposure_given =
      !options.exposures.empty() || !options.locked_exposure.empty() || !options.state.empty();
  choose_sdr(options, !options.exposures.empty() || !options.locked_exposure.empty());
  choose_view_defaults(options, exposure_given);
  return finish_server_options(options.server);
}

constexpr size_t kMostNotes = 5;

// Where the images are; "": there are none.
std::string places_of(const StreamOptions& options, const StreamPlan& plan, const RunSummary& summary) {
  if (options.film) return options.output;
  if (options.pipe) return kStdoutName;
  if (!plan.names) return "";
  const auto at = [&](int64_t number, uint64_t place) {
    FrameFacts frame;
    frame.number = number;
    frame.place = place;
    return output_of(options, plan, frame);
  };
  const size_t images = plan.images.empty() ? plan.sequence.frames.size() : plan.images.size();
  return absl::StrFormat("%s .. %s", at(summary.first, 0), at(summary.last, images - 1));
}

// What ffmpeg is started with, for a shell. A film's file has its name only at the end.
std::string command_line(const StreamOptions& options) {
  std::string line;
  const WriteOptions& write = options.write;
  for (const std::string& word : film_command(*options.film, write.transfer, write.hdr, options.output)) {
    const bool plain = word.find_first_not_of(
                           "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                           "-_=:+./,") == std::string::npos;
    absl::StrAppend(&line, line.empty() ? "" : " ",
                    plain ? word : "'" + absl::StrReplaceAll(word, {{"'", "'\\''"}}) + "'");
  }
  return line;
}

// Prints the notes and the summary: on stderr, if frames go to stdout.
absl::Status tell(const StreamOptions& options, const RunSummary& summary, const std::string& where,
                  bool json_to_stdout) {
  if (options.quiet) return absl::OkStatus();
  std::set<std::string> notes = summary.notes;
  notes.insert(options.notes.begin(), options.notes.end());
  size_t told = 0;
  for (const std::string& note : notes) {
    if (told++ < kMostNotes) print_note(note);
  }
  if (told > kMostNotes) print_note(absl::StrFormat("and %d more notes", told - kMostNotes));
  if (summary.reader_left) {
    const uint64_t frames = summary.written + summary.held;
    print_note(absl::StrFormat("whoever read standard output stopped after %d frame%s, and so did this",
                               frames, frames == 1 ? "" : "s"));
  }
  if (options.to_stdout()) std::fputs(to_text(summary, where).c_str(), stderr);
  return json_to_stdout || options.to_stdout() ? absl::OkStatus() : print(to_text(summary, where));
}

constexpr char kStreamExamples[] =
    "Examples:\n"
    "  candela stream 'in/*.exr' out/%04d.png --fps 24\n"
    "  candela stream in out --lookahead 4 --detect-cuts --exposure-plot exposure.svg\n"
    "  candela stream in out --server 127.0.0.1:50051,127.0.0.1:50052 --json frames.json\n"
    "  candela stream 'in/shot.####.exr' review.mp4 --fps 24 -v\n"
    "  ffmpeg -i in.mov -f image2pipe -c:v phm - | candela stream - - --fps 24 | ffmpeg -i - out.mp4";

Finish define_stream(CLI::App& app) {
  const auto arguments = std::make_shared<StreamArguments>();
  add_stream_options(app, *arguments);
  return [arguments](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_stream_options(*arguments));
    StreamOptions& options = arguments->options;
    add_idle_notes(options, {.given = given,
                             .encoding = options.pipe ? &piped_encoding(options.pipe->kind)
                                                      : encoding_of(options.output, options.encoding),
                             .view = !options.view.config.empty(),
                             .adapts = true,
                             .elapsed_seconds = std::numeric_limits<double>::infinity()});
    return parsed_command(options, run_stream);
  };
}

}  // namespace

absl::Status run_stream(const StreamOptions& options, JsonOutput& json) {
  ASSIGN_OR_RETURN(const ShotExposures shot, ShotExposures::open(options));
  ASSIGN_OR_RETURN(StreamPlan plan, plan_stream(options, shot));
  const Sequence& sequence = plan.sequence;
  const bool wants_exposures = shot.saved() || !options.plot.empty();
  if (sequence.frames.empty() && !options.from_stdin() && wants_exposures) {
    return usage_error(
        "every image repeats a frame before --range, so there are no exposures to save or to draw; leave out "
        "--save-exposures and --exposure-plot, or give another --range");
  }
  RETURN_IF_ERROR(shot.prepare_save());
  if (!options.plot.empty()) {
    RETURN_IF_ERROR(check_plot(options.plot));
  }
  RETURN_IF_ERROR(json.open());
  if (options.to_stdout()) {
    RETURN_IF_ERROR(check_stdout(json));
  }
  if (options.film) {
    RETURN_IF_ERROR(make_folder_of(options.output));
  }
  if (plan.names) {
    RETURN_IF_ERROR(make_folder_of(plan.names->path(0, "")));
  }
  if (!options.quiet) {
    for (const std::string& note : sequence.notes) print_note(note);
    if (options.film && options.verbose) print_note(command_line(options));
  }
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  RunDisplay display(options.quiet, json, progress);
  const absl::StatusOr<RunSummary> summary = render_sequence(options, shot, plan, display);
  progress.clear();
  if (!summary.ok()) return summary.status();
  if (summary->reader_left && wants_exposures) {
    return failure_of(FailureKind::kOutput,
                      absl::AbortedError("whoever read standard output stopped before the last frame, so "
                                         "there are no exposures of all frames to save or to draw"));
  }
  if (summary->curve.empty() && wants_exposures) {
    return failure_of(
        FailureKind::kInput,
        absl::NotFoundError("no frame of its own was rendered, so there is no exposure to save or "
                            "to draw"));
  }
  if (shot.saved()) {
    RETURN_IF_ERROR(shot.save(sequence, summary->rate.rate, summary->curve, summary->state));
  }
  if (!options.plot.empty()) {
    RETURN_IF_ERROR(plot_exposure(summary->curve, options.plot));
  }
  RETURN_IF_ERROR(tell(options, *summary, places_of(options, plan, *summary), json.to_stdout()));
  RETURN_IF_ERROR(json.add(to_json(*summary)));
  return json.close();
}

const Command kStreamCommand{"stream", "Renders a sequence of frames with exposure that adapts over time.",
                             kStreamExamples, define_stream};

}  // namespace candela
