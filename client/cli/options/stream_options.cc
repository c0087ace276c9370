#include "client/cli/options/stream_options.h"

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/cli/files/sequence_files.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/render_options.h"
#include "client/cli/options/security_options.h"
#include "client/cli/options/usage.h"

namespace candela {
namespace {

constexpr char kSession[] = "Session";
constexpr char kServer[] = "Server";
constexpr char kLoad[] = "Load";

constexpr v1::Range<double> kFps{0.001, 100000};
constexpr v1::Range<double> kSeconds{0.001, 86400};
constexpr v1::Range<double> kFirst{0, 1e9};
constexpr v1::Range<double> kSessions{1, 256};
constexpr double kGoodCutEv = 1;
constexpr double kDefaultFps = 24;

// "ADDRESS,ADDRESS": the first and the others.
absl::Status set_servers(const std::string& text, ServerChoice& choice) {
  std::vector<std::string> addresses = absl::StrSplit(text, ',');
  for (const std::string& address : addresses) {
    if (address.empty()) {
      return usage_error(
          absl::StrFormat("--server is \"%s\"; it must be addresses with commas between", text));
    }
  }
  choice.address = addresses.front();
  choice.others.assign(addresses.begin() + 1, addresses.end());
  return absl::OkStatus();
}

void add_device_option(CLI::App& app, ServerChoice& choice) {
  add_text(app, kServer, "--device", "NAME|INDEX",
           "Device of the server inside: a part of its name, or its number (default: the best there is)",
           [&choice](const std::string& device) {
             choice.device = device;
             return absl::OkStatus();
           });
}

void add_lookahead(CLI::App& app, const std::string& section, uint32_t& frames) {
  add_number(
      app, section, "--lookahead", "N", {0, double{v1::kLookahead.max}}, 0,
      "Frames that exposure looks ahead, and that images come later",
      [&frames](double n) { frames = static_cast<uint32_t>(n); }, true);
}

void add_encoding(CLI::App& app, const std::string& section, v1::Encoding& encoding,
                  const std::string& help) {
  add_enum<v1::Encoding>(app, section, "--encoding", "encoding", v1::ENCODING_RAW, help,
                         [&encoding](v1::Encoding chosen) { encoding = chosen; });
}

void add_timeout(CLI::App& app, const std::string& section, absl::Duration& timeout) {
  add_text(app, section, "--frame-timeout", "S",
           absl::StrFormat("A frame that waits longer on the server is dropped; %s (default: none)",
                           format_range(kSeconds)),
           [&timeout](const std::string& text) {
             const absl::StatusOr<double> seconds = parse_number("--frame-timeout", text, kSeconds);
             if (seconds.ok()) timeout = absl::Seconds(*seconds);
             return seconds.status();
           });
}

// With a value or without: --detect-cuts, --detect-cuts=0.7, --detect-cuts 0.7.
void add_cuts(CLI::App& app, double& threshold_ev) {
  const auto take = [&threshold_ev](const std::string& text) {
    threshold_ev = kGoodCutEv;
    if (text.empty()) return;
    const absl::StatusOr<double> ev = parse_number("--detect-cuts", text, v1::kCutThresholdEv);
    if (!ev.ok()) {
      throw OptionError{usage_error(absl::StrFormat(
          "%s; without a number it stands last or before another option", ev.status().message()))};
    }
    threshold_ev = *ev;
  };
  app.add_option_function<std::string>(
         "--detect-cuts", take,
         absl::StrFormat("A frame that differs from the one before by more than this begins a scene, whose "
                         "exposure is taken at once; %s (%s when none is given; default: no detection)",
                         format_range(v1::kCutThresholdEv), format_number(kGoodCutEv)))
      ->option_text("[EV]")
      ->expected(0, 1)
      ->group(kSession)
      ->take_last();
}

}  // namespace

absl::Status parse_size(const std::string& text, uint32_t& width, uint32_t& height) {
  const std::vector<std::string> parts = absl::StrSplit(text, 'x');
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

void add_stream_options(CLI::App& app, StreamArguments& arguments) {
  StreamOptions& options = arguments.options;
  app.add_option(
         "IN... OUT", arguments.files,
         "IN: frames in the natural order of their names: a folder, files, 'in/*.exr' or in/%04d.exr. "
         "OUT: a pattern with the number, out/%04d.png (or .jpg, .exr, .pfm), or a folder for .png")
      ->required()
      ->option_text(" ");
  add_number(app, kSession, "--fps", "F", kFps, kDefaultFps, "Frames a second of media time",
             [&options](double fps) { options.fps = fps; });
  add_lookahead(app, kSession, options.lookahead);
  add_cuts(app, options.cut_threshold_ev);
  add_timeout(app, kSession, options.timeout);
  app.add_flag("--skip-bad", options.skip_bad,
               "Go on after files that cannot be read and frames that fail; they keep their time and number")
      ->group(kSession);
  add_settings_options(app, options);
  add_image_options(app, arguments.picture);
  add_encoding(app, kOutputSection, options.encoding,
               "Who makes the files: raw, this command; png or jpeg, the "
               "server");
  add_number(
      app, kOutputSection, "--first", "N", kFirst, 0, "Number of the first image in OUT's pattern",
      [&options](double n) { options.first = static_cast<uint64_t>(n); }, true);
  add_text(app, kOutputSection, "--exposure-plot", "FILE",
           "Draw exposure over time: .png or .svg (needs gnuplot)", [&options](const std::string& path) {
             options.plot = path;
             return absl::OkStatus();
           });
  add_json_option(app, kOutputSection, "Write a line of JSON for each frame and one for all, - for stdout",
                  options.json);
  app.add_flag("--quiet,-q", options.quiet, "Print nothing but errors")->group(kOutputSection);
  add_text(
      app, kServer, "--server", "ADDRESS[,...]",
      "Running candelads, HOST:PORT or unix:PATH: the first one that is there, and the next when it is lost "
      "(default: none, a server inside this process)",
      [&options](const std::string& text) { return set_servers(text, options.server); });
  add_security_options(app, kServer, options.server.security);
  add_device_option(app, options.server);
  add_number(app, kServer, "--resume", "S", {0, kSeconds.max}, absl::ToDoubleSeconds(options.resume_limit),
             "Seconds to look for a server when one is lost",
             [&options](double seconds) { options.resume_limit = absl::Seconds(seconds); });
  add_text(app, kServer, "--session", "NAME", "Name of the session (default: a random one)",
           [&options](const std::string& name) {
             options.session = name;
             return absl::OkStatus();
           });
}

absl::Status finish_stream_options(StreamArguments& arguments) {
  StreamOptions& options = arguments.options;
  if (arguments.files.size() < 2) {
    return usage_error(
        "stream needs its frames and where the images go: candela stream 'in/*.exr' out/%04d.png");
  }
  options.inputs.assign(arguments.files.begin(), arguments.files.end() - 1);
  options.output = arguments.files.back();
  const bool jpeg = options.encoding == v1::ENCODING_JPEG;
  const absl::StatusOr<OutputNames> names = OutputNames::parse(options.output, jpeg ? ".jpg" : ".png");
  if (!names.ok()) return names.status();
  const std::string sample = names->is_folder() ? options.output + "/*" + names->extension() : options.output;
  if (absl::Status status = finish_picture_options(options, arguments.picture, sample); !status.ok()) {
    return status;
  }
  const OutputKind kind = *output_kind(sample);
  if ((jpeg && kind != OutputKind::kJpeg) ||
      (options.encoding == v1::ENCODING_PNG && kind != OutputKind::kPng)) {
    return usage_error(
        absl::StrFormat("--encoding makes %s files, and %s is none; change the one or the other",
                        jpeg ? "JPEG" : "PNG", options.output));
  }
  return check_server_options(options.server);
}

void add_meter_command(CLI::App& app, MeterOptions& options) {
  app.add_option("IN", options.input, "Image to meter: OpenEXR, Radiance .hdr or PFM")
      ->required()
      ->option_text(" ");
  add_meter_options(app, options.settings);
  add_json_option(app, kOutputSection, "Write it as one line of JSON, - for stdout", options.json);
  add_server_options(app, options.server);
}

void add_bench_options(CLI::App& app, BenchOptions& options) {
  add_number(
      app, kLoad, "--sessions", "N", kSessions, options.sessions, "Sessions at once",
      [&options](double n) { options.sessions = static_cast<uint32_t>(n); }, true);
  add_text(app, kLoad, "--size", "WIDTHxHEIGHT",
           absl::StrFormat("Pixels of a frame of halves (default %dx%d)", options.width, options.height),
           [&options](const std::string& text) { return parse_size(text, options.width, options.height); });
  add_text(app, kLoad, "--fps", "F|max",
           absl::StrFormat("Frames a second of each session, %s; one that is not taken in time is dropped "
                           "(default max: as many as it takes)",
                           format_range(kFps)),
           [&options](const std::string& text) {
             options.fps = 0;
             if (text == "max") return absl::OkStatus();
             const absl::StatusOr<double> fps = parse_number("--fps", text, kFps);
             if (!fps.ok()) return usage_error(absl::StrFormat("%s, or max", fps.status().message()));
             options.fps = *fps;
             return absl::OkStatus();
           });
  add_number(app, kLoad, "--seconds", "S", {0.1, kSeconds.max}, absl::ToDoubleSeconds(options.duration),
             "How long to measure", [&options](double s) { options.duration = absl::Seconds(s); });
  add_lookahead(app, kLoad, options.lookahead);
  add_timeout(app, kLoad, options.timeout);
  add_encoding(app, kLoad, options.encoding, "What the images come back as");
  add_json_option(app, kOutputSection, "Write the figures as one line of JSON, - for stdout", options.json);
  app.add_flag("--quiet,-q", options.quiet, "Print nothing but errors")->group(kOutputSection);
  add_server_options(app, options.server);
}

absl::Status finish_bench_options(const BenchOptions& options) {
  return check_server_options(options.server);
}

}  // namespace candela
