// The command line's grammar: subcommands, help, and errors for words that are not in it.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iterator>
#include <limits>
#include <map>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/cli/environment/panorama_options.h"
#include "client/cli/files/sequence_files.h"
#include "client/cli/options/bench_options.h"
#include "client/cli/options/check_words.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/meter_options.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/options.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/render_options.h"
#include "client/cli/options/report_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/options/stream_options.h"
#include "client/cli/options/usage.h"
#include "client/image/encodings.h"
#include "server/base/address.h"

#ifndef CANDELA_VERSION
#error "the build sets CANDELA_VERSION"
#endif

namespace candela {
namespace {

constexpr char kExamples[] =
    "Examples:\n"
    "  candela sample scene.exr              make a scene to try things on\n"
    "  candela render scene.exr scene.png    render it here, without a server\n"
    "  candela render 'in/*.exr' out/         render each image for itself\n"
    "  candela stream 'in/*.exr' out/%04d.png  render a sequence, exposure adapting over time\n"
    "  candela view pano.hdr view.png        look into a panorama\n"
    "  candela info                          describe the device this machine renders on\n"
    "`candela help COMMAND` lists a command's options. $CANDELA_SERVER is the default of --server.\n"
    "Exit codes: 2 wrong usage, 3 an input, 4 the server or the device, 5 an output, 1 anything else.";

constexpr char kRenderExamples[] =
    "Examples:\n"
    "  candela render in.exr out.png\n"
    "  candela render in.hdr out.png --exposure -2 --curve aces-narkowicz --bits 16\n"
    "  candela render a.exr b.hdr 'more/*.exr' out/ --as jpg\n"
    "  candela render in.exr out.jpg --server 127.0.0.1:50051 --json -";

constexpr v1::Range<double> kTimeoutSeconds{0.001, 3600};
// Of `candela sample`.
constexpr uint32_t kSceneWidth = 1920, kSceneHeight = 1080;
constexpr uint32_t kPanoramaWidth = 1024, kPanoramaHeight = 512;

constexpr char kStreamExamples[] =
    "Examples:\n"
    "  candela stream 'in/*.exr' out/%04d.png --fps 24\n"
    "  candela stream in out --lookahead 4 --detect-cuts --exposure-plot exposure.svg\n"
    "  candela stream in out --server 127.0.0.1:50051,127.0.0.1:50052 --json frames.json";

constexpr char kMeterExamples[] =
    "Examples:\n"
    "  candela meter in.exr --percentiles 5,95 --json -\n"
    "  candela meter 'shot/*.exr' --lookahead 4 --detect-cuts --save-exposures shot.json\n"
    "  candela stream 'shot/*.exr' out/%04d.png --range 100-149 --exposures shot.json\n"
    "  candela stream 'shot/*.exr' out/%04d.png --locked-exposure shot.json";

constexpr char kViewExamples[] =
    "Examples:\n"
    "  candela view pano.hdr view.png --yaw 30 --pitch 10 --fov 70 --objects lookdev\n"
    "  candela view pano.hdr out/%04d.png --turn 360 --frames 240 --fps 24\n"
    "  candela view pano.exr out/%04d.png --path keys.json --exposure-plot exposure.svg";

constexpr char kEnvironmentExamples[] =
    "Examples:\n"
    "  candela environment pano.hdr pano.ktx2 --sh pano.json --preview pano.png\n"
    "  candela environment pano.hdr pano.ktx2 --handedness right --roughness-mapping perceptual\n"
    "  candela environment pano.exr faces/ --size 512\n"
    "  candela environment pano.exr cross.exr --layout cross";

constexpr char kBenchExamples[] =
    "Examples:\n"
    "  candela bench --server 127.0.0.1:50051 --sessions 4 --size 1280x720\n"
    "  candela bench --server 127.0.0.1:50051 --fps 24 --seconds 60 --json figures.json";

constexpr char kSampleExamples[] =
    "Examples:\n"
    "  candela sample scene.exr --size 1280x720\n"
    "  candela sample --sequence in --frames 96\n"
    "  candela sample --panorama pano.exr";

constexpr char kReportExamples[] =
    "Examples:\n"
    "  candela report out --quick\n"
    "  candela report out --images a.exr b.hdr";

constexpr char kInfoExamples[] =
    "`candela info FILE...` also says what would be rendered of each file.\n"
    "`candela info --json -` also lists every setting with its range, default and choices.\n\n"
    "Examples:\n"
    "  candela info\n"
    "  candela info shot.exr\n"
    "  candela info --server 127.0.0.1:50051 --json -";

constexpr char kHealthExamples[] =
    "Examples:\n"
    "  candela health\n"
    "  candela health --server render.example:50051 --tls-ca ca.pem --timeout 1";

struct Arguments {
  RenderArguments render;
  StreamArguments stream;
  MeterOptions meter;
  PanoramaViewArguments view;
  EnvironmentArguments environment;
  BenchOptions bench;
  SampleOptions sample;
  ReportOptions report;
  InfoOptions info;
  HealthOptions health;
  std::string help;  // the command of `candela help`
};

void add_sample(CLI::App& app, SampleOptions& sample) {
  app.add_option("OUT", sample.output, "File to write: .exr or .pfm; not with --sequence or --panorama")
      ->option_text(" ");
  add_text(app, "Options", "--size", "WIDTHxHEIGHT",
           absl::StrFormat("Pixels; 1x1 .. %dx%d (default %dx%d, of a panorama %dx%d)", v1::kMaxDimension,
                           v1::kMaxDimension, kSceneWidth, kSceneHeight, kPanoramaWidth, kPanoramaHeight),
           [&sample](const std::string& text) { return parse_size(text, sample.width, sample.height); });
  add_text(
      app, "Options", "--sequence", "DIR|PATTERN",
      "Write a sequence instead, to a folder or to a pattern such as in/%04d.exr; in the middle its light "
      "changes by a factor of 2^12",
      sample.sequence);
  add_text(
      app, "Options", "--panorama", "FILE",
      "Write a panorama instead, .exr or .pfm: sky, sun and ground, and at each quarter of the horizon a "
      "wall of another colour",
      sample.panorama);
  add_number(
      app, "Options", "--frames", "N", {2, 100000}, static_cast<double>(sample.frames),
      "Frames of the sequence", [&sample](double n) { sample.frames = static_cast<uint64_t>(n); }, true);
  add_quiet_option(app, "Options", sample.quiet);
}

void add_health(CLI::App& app, HealthOptions& health) {
  add_running_server_option(app, "Options", health.server);
  add_security_options(app, "Options", health.server.security);
  add_number(app, "Options", "--timeout", "SECONDS", kTimeoutSeconds, absl::ToDoubleSeconds(health.timeout),
             "How long to wait for an answer",
             [&health](double seconds) { health.timeout = absl::Seconds(seconds); });
}

void define_panoramas(CLI::App& app, Arguments& arguments) {
  CLI::App& view =
      *app.add_subcommand("view", "Renders a view of a panorama, or a sequence with a moving camera.");
  view.footer(kViewExamples);
  add_panorama_view_options(view, arguments.view);
  CLI::App& environment = *app.add_subcommand(
      "environment", "Bakes a panorama into a cube map with specular levels, for renderers and engines.");
  environment.footer(kEnvironmentExamples);
  add_environment_options(environment, arguments.environment);
}

void define(CLI::App& app, Arguments& arguments) {
  app.require_subcommand(0, 1);
  app.get_formatter()->column_width(32);
  app.get_formatter()->label("SUBCOMMAND", "COMMAND");
  app.get_formatter()->label("Positionals", "Arguments");
  app.set_help_flag("--help,-h", "Print this help and exit");
  app.set_version_flag("--version", "candela " CANDELA_VERSION, "Print the version and exit");
  CLI::App& render = *app.add_subcommand("render", "Renders an HDR image: exposure, bloom, tone curve.");
  render.footer(kRenderExamples);
  add_render_options(render, arguments.render);
  CLI::App& stream =
      *app.add_subcommand("stream", "Renders a sequence of frames with exposure that adapts over time.");
  stream.footer(kStreamExamples);
  add_stream_options(stream, arguments.stream);
  CLI::App& meter = *app.add_subcommand(
      "meter",
      "Reports the exposure that metering chooses for an image, or for each frame of a shot, and why.");
  meter.footer(kMeterExamples);
  add_meter_options(meter, arguments.meter);
  define_panoramas(app, arguments);
  CLI::App& sample =
      *app.add_subcommand("sample", "Makes a procedural HDR scene, a sequence of them, or a panorama.");
  sample.footer(kSampleExamples);
  add_sample(sample, arguments.sample);
  CLI::App& report = *app.add_subcommand("report", "Measures this machine and writes a report page.");
  report.footer(kReportExamples);
  add_report_options(report, arguments.report);
  CLI::App& bench = *app.add_subcommand("bench", "Measures a server under the load of several sessions.");
  bench.footer(kBenchExamples);
  add_bench_options(bench, arguments.bench);
  CLI::App& info = *app.add_subcommand(
      "info", "Describes image files: parts, layers, channels, windows. Without files, describes a server.");
  info.footer(kInfoExamples);
  info.add_option("FILE", arguments.info.files, "Images to describe (default: describe the server)")
      ->option_text("...");
  add_json_option(info, kOutputSection,
                  "Write one line of JSON a file, or one for the server with every setting",
                  arguments.info.json);
  add_server_options(info, arguments.info.server);
  CLI::App& health = *app.add_subcommand(
      "health", "Checks whether a server is serving: exit code 0 if so, 1 if not, 2 for wrong usage.");
  health.footer(kHealthExamples);
  add_health(health, arguments.health);
  app.add_subcommand("help", "Prints the help of a command.")
      ->add_option("COMMAND", arguments.help, "One of the commands (default: all of them, in short)")
      ->option_text(" ");
  for (CLI::App* command : app.get_subcommands({})) command->group("Commands");
  app.footer(kExamples);
}

// The help of a command, or of the whole program for null. CLI11 leaves two empty lines between sections, and
// marks OUT as repeatable with the inputs.
std::string help(const CLI::App& app, const CLI::App* command) {
  const CLI::App& shown = command == nullptr ? app : *command;
  const std::string name = command == nullptr ? app.get_name() : app.get_name() + " " + command->get_name();
  const std::string text = app.get_formatter()->make_help(&shown, name, CLI::AppFormatMode::Normal);
  return absl::StrReplaceAll(text, {{"\n\n\n", "\n\n"}, {"OUT...", "OUT"}});
}

absl::Status finish_sample_options(SampleOptions& sample) {
  if (!sample.output.empty() + !sample.sequence.empty() + !sample.panorama.empty() != 1) {
    return usage_error(
        "sample makes a scene, a sequence or a panorama: give OUT, --sequence DIR or --panorama FILE, one of "
        "them");
  }
  if (sample.width == 0) {
    sample.width = sample.panorama.empty() ? kSceneWidth : kPanoramaWidth;
    sample.height = sample.panorama.empty() ? kSceneHeight : kPanoramaHeight;
  }
  std::string path = sample.output + sample.panorama;
  if (absl::Status status = check_output_name(path + sample.sequence); !status.ok()) return status;
  if (!sample.sequence.empty()) {
    const absl::StatusOr<OutputNames> names = OutputNames::parse(sample.sequence, ".exr");
    if (!names.ok()) return names.status();
    path = names->path(0, "");
  }
  if (const auto found = output_encoding(path); found.ok() && (*found)->holds_light())
    return absl::OkStatus();
  return usage_error(absl::StrFormat("%s: a scene is written as %s; `candela render` makes a .png of it",
                                     path, extensions_with(&OutputEncoding::holds_light)));
}

// The options on the command line and their values.
std::map<std::string, std::string> given_options(const std::vector<std::string>& words) {
  std::map<std::string, std::string> given;
  for (size_t i = 0; i < words.size() && words[i] != "--"; ++i) {
    if (!absl::StartsWith(words[i], "--")) continue;
    const std::pair<std::string, std::string> parts = absl::StrSplit(words[i], absl::MaxSplits('=', 1));
    const bool own_word = parts.first == words[i] && i + 1 < words.size();
    given[parts.first] = own_word ? words[i + 1] : parts.second;
  }
  return given;
}

// Adds a note for each option that changes nothing.
template <typename Options>
Options with_notes(Options options, const std::vector<std::string>& words, Request request) {
  request.settings = options.settings;
  if (!options.server.address.empty()) request.servers = {options.server.address};
  request.servers.insert(request.servers.end(), options.server.others.begin(), options.server.others.end());
  request.given = given_options(words);
  std::vector<std::string> notes = idle_options(std::move(request));
  std::move(notes.begin(), notes.end(), std::back_inserter(options.notes));
  return options;
}

// The encoding of the images that a file name, a pattern or a folder gets.
const OutputEncoding* encoding_of(const std::string& output, v1::Encoding by_server = v1::ENCODING_RAW) {
  const absl::StatusOr<const OutputEncoding*> named = output_encoding(output);
  return named.ok() ? *named : &output_encoding(by_server);
}

absl::StatusOr<Invocation> finish_images(const CLI::App& app, const std::vector<std::string>& words,
                                         Arguments& arguments) {
  if (app.got_subcommand("render")) {
    if (absl::Status status = finish_render_options(arguments.render); !status.ok()) return status;
    const RenderOptions& options = arguments.render.options;
    return with_notes(
        options, words,
        {.encoding = encoding_of(options.extension.empty() ? options.output : "*" + options.extension),
         .view = !options.view.config.empty(),
         .adapts = options.previous.exposure() > 0,
         .elapsed_seconds = options.previous.elapsed_seconds()});
  }
  if (app.got_subcommand("stream")) {
    if (absl::Status status = finish_stream_options(arguments.stream); !status.ok()) return status;
    const StreamOptions& options = arguments.stream.options;
    return with_notes(options, words,
                      {.encoding = encoding_of(options.output, options.encoding),
                       .view = !options.view.config.empty(),
                       .adapts = true,
                       .elapsed_seconds = std::numeric_limits<double>::infinity()});
  }
  if (absl::Status status = finish_meter_options(arguments.meter); !status.ok()) return status;
  return with_notes(arguments.meter, words,
                    {.adapts = true, .elapsed_seconds = std::numeric_limits<double>::infinity()});
}

// Of `candela view` and `candela environment`.
absl::StatusOr<Invocation> finish_panoramas(const CLI::App& app, const std::vector<std::string>& words,
                                            Arguments& arguments) {
  if (app.got_subcommand("environment")) {
    if (absl::Status status = finish_environment_options(arguments.environment); !status.ok()) return status;
    return with_notes(arguments.environment.options, words, {});
  }
  if (absl::Status status = finish_panorama_view_options(arguments.view); !status.ok()) return status;
  const PanoramaViewOptions& options = arguments.view.options;
  return with_notes(options, words,
                    {.encoding = encoding_of(options.output, options.encoding),
                     .view = !options.view.config.empty(),
                     .adapts = options.is_sequence() || options.previous.exposure() > 0,
                     .elapsed_seconds = options.is_sequence() ? std::numeric_limits<double>::infinity()
                                                              : options.previous.elapsed_seconds()});
}

absl::StatusOr<Invocation> finish_help(const CLI::App& app, const std::string& command) {
  if (command.empty()) return TextToPrint{help(app, nullptr)};
  const auto named = [&command](const CLI::App* known) { return known->check_name(command); };
  const std::vector<const CLI::App*> found = app.get_subcommands(named);
  if (found.empty()) return unknown_word("command", command, command_names(app));
  return TextToPrint{help(app, found.front())};
}

absl::StatusOr<Invocation> finish_health(HealthOptions health) {
  if (absl::Status status = finish_server_options(health.server); !status.ok()) return status;
  if (health.server.address.empty()) {
    health.server.address = kDefaultAddress;
    health.server.source = "candelad's default; --server names another";
  }
  return health;
}

absl::StatusOr<Invocation> finish(const CLI::App& app, const std::vector<std::string>& words,
                                  Arguments& arguments) {
  if (app.got_subcommand("render") || app.got_subcommand("stream") || app.got_subcommand("meter")) {
    return finish_images(app, words, arguments);
  }
  if (app.got_subcommand("view") || app.got_subcommand("environment")) {
    return finish_panoramas(app, words, arguments);
  }
  if (app.got_subcommand("bench")) {
    if (absl::Status status = finish_server_options(arguments.bench.server); !status.ok()) return status;
    return arguments.bench;
  }
  if (app.got_subcommand("sample")) {
    if (absl::Status status = finish_sample_options(arguments.sample); !status.ok()) return status;
    return arguments.sample;
  }
  if (app.got_subcommand("report")) {
    if (absl::Status status = finish_report_options(arguments.report); !status.ok()) return status;
    return arguments.report;
  }
  if (app.got_subcommand("info")) {
    absl::Status status = check_input_names(arguments.info.files);
    status.Update(finish_server_options(arguments.info.server));
    if (!status.ok()) return status;
    return arguments.info;
  }
  if (app.got_subcommand("health")) return finish_health(std::move(arguments.health));
  if (app.got_subcommand("help")) return finish_help(app, arguments.help);
  return TextToPrint{help(app, nullptr)};
}

// CLI11's own message, in one line.
absl::Status refused(const CLI::App& app, const CLI::Error& error) {
  const std::vector<CLI::App*> commands = app.get_subcommands();
  std::string what = error.what();
  what = what.substr(0, what.find('\n'));
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) {
    what = what.substr(0, what.find(':')) + " needs a value";
  }
  if (dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr && !commands.empty()) {
    what = absl::StrFormat("\"%s\" is one argument too many", app.remaining(true).back());
  }
  return usage_error(absl::StrFormat("%s; see candela%s --help", what,
                                     commands.empty() ? "" : " " + commands.front()->get_name()));
}

// The words for CLI11, last one first. All words after "--" are paths. CLI11 gives them to no list of files,
// so
// "--" is left out, and a path that begins with "-" gets "./" before it.
std::vector<std::string> for_parser(const std::vector<std::string>& words) {
  const auto mark = std::find(words.begin(), words.end(), "--");
  std::vector<std::string> parsed(words.begin(), mark);
  for (auto word = mark; word != words.end(); ++word) {
    if (word != mark) parsed.push_back(absl::StartsWith(*word, "-") ? "./" + *word : *word);
  }
  std::reverse(parsed.begin(), parsed.end());
  return parsed;
}

}  // namespace

std::string json_path_in(const std::vector<std::string>& words) {
  const std::map<std::string, std::string> given = given_options(words);
  const auto json = given.find("--json");
  const bool is_path = json != given.end() && (json->second == "-" || !absl::StartsWith(json->second, "-"));
  return is_path ? json->second : "";
}

absl::StatusOr<Invocation> parse_command_line(const std::vector<std::string>& words) {
  Arguments arguments;
  CLI::App app("candela: renders HDR images for a display, here or on a server.\n", "candela");
  define(app, arguments);
  if (absl::Status status = check_words(app, words); !status.ok()) return status;
  try {
    app.parse(for_parser(words));
    return finish(app, words, arguments);
  } catch (const CLI::CallForHelp&) {
    const std::vector<CLI::App*> commands = app.get_subcommands();
    return TextToPrint{help(app, commands.empty() ? nullptr : commands.front())};
  } catch (const CLI::CallForVersion& version) {
    return TextToPrint{absl::StrFormat("%s\n", version.what())};
  } catch (const CLI::Error& error) {
    return refused(app, error);
  } catch (const OptionError& error) {
    return error.status;
  }
}

}  // namespace candela
