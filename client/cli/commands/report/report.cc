// `candela report`: measures this machine and writes a page.
#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <thread>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/report/errors.h"
#include "client/cli/commands/report/files.h"
#include "client/cli/commands/report/times.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/options.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/run_display.h"
#include "client/cli/terminal.h"
#include "client/image/sample.h"
#include "client/run/output_files.h"
#include "client/run/panorama_file.h"
#include "client/run/picture_error.h"
#include "client/run/picture_frame.h"
#include "client/run/server_link.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr char kSection[] = "Measurement";
constexpr v1::Range<double> kMegapixels{0.001, 256};

absl::Status set_megapixels(ReportOptions& options, const std::string& text) {
  std::vector<double> sizes;
  for (absl::string_view part : absl::StrSplit(text, ',')) {
    ASSIGN_OR_RETURN(const double size, parse_number("--megapixels", std::string(part), kMegapixels));
    sizes.push_back(size);
  }
  std::sort(sizes.begin(), sizes.end());
  sizes.erase(std::unique(sizes.begin(), sizes.end()), sizes.end());
  options.megapixels = std::move(sizes);
  return absl::OkStatus();
}

// Defines the options; parsing fills `options`, which outlives the app.
void add_report_options(CLI::App& app, ReportOptions& options) {
  app.add_option("DIR", options.directory, "Folder to write into; created if it does not exist")
      ->required()
      ->option_text(" ");
  app.add_flag("--quick", options.quick,
               "Take at most five minutes: fewer frames, smaller images; the page says what was left out")
      ->group(kSection);
  add_text(app, kSection, "--megapixels", "LIST",
           absl::StrFormat("Frame sizes, separated by commas; each %s (default 0.25,1,2,8,33)",
                           format_range(kMegapixels)),
           [&options](const std::string& text) { return set_megapixels(options, text); });
  app.add_option("--images", options.images,
                 "Images to compare with the reference (default: the sample scene)")
      ->option_text("FILE...")
      ->group(kSection);
  app.add_option("--panoramas", options.panoramas, "Panoramas to bake (default: the sample panorama)")
      ->option_text("FILE...")
      ->group(kSection);
  add_quiet_option(app, "Output", options.quiet);
  options.server.bakes = true;
  add_server_options(app, options.server);
}

// After parsing: sets the default sizes if none were given, and refuses options that conflict.
absl::Status finish_report_options(ReportOptions& options) {
  if (options.megapixels.empty()) options.megapixels = {0.25, 1, 2, 8, 33};
  absl::Status status = check_output_name(options.directory);
  status.Update(check_input_names(options.images));
  status.Update(check_input_names(options.panoramas));
  status.Update(finish_server_options(options.server));
  return status;
}

// The version of report.json, which docs/report/format.md
// describes. A change that breaks a reader increments it.
constexpr int kFormatVersion = 1;

// Verification takes seconds per megapixel, so larger images are cropped to this.
constexpr double kQuickImageMegapixels = 1;
constexpr double kImageMegapixels = 4;

// Of the sample panorama, in texels.
constexpr uint32_t kQuickPanoramaHeight = 256;
constexpr uint32_t kFullPanoramaHeight = 512;

// The last measurement of --quick ends by then, so that everything is written within five minutes.
constexpr absl::Duration kQuickTime = absl::Seconds(280);

TimePlan time_plan(const ReportOptions& options, absl::Time begin) {
  TimePlan plan;
  for (const double megapixels : options.megapixels) plan.sizes.push_back(frame_size(megapixels));
  if (options.quick) {
    plan.frames = 5;
    plan.slow_frames = 1;
    plan.deadline = begin + kQuickTime;
  }
  return plan;
}

// The files that the report writes, with the error maps of these tiers.
std::vector<OutputFile> outputs_of(const ReportOptions& options, const std::vector<std::string>& tiers) {
  std::vector<OutputFile> outputs;
  for (const char* name :
       {"index.html", "report.json", "times.csv", "hard_cases.csv", "aces.csv", "bakes.csv", "files.csv"}) {
    outputs.push_back({absl::StrCat(options.directory, "/", name), "the report"});
  }
  for (size_t i = 1; i <= options.images.size(); ++i) {
    outputs.push_back({absl::StrCat(options.directory, "/image_", i, ".png"), "the report"});
    for (const std::string& tier : tiers) {
      outputs.push_back({absl::StrCat(options.directory, "/", error_map_name(i, tier)), "the report"});
    }
  }
  for (size_t i = 1; i <= options.panoramas.size(); ++i) {
    for (const std::string& name : {levels_name(i), lookdev_name(i)}) {
      outputs.push_back({absl::StrCat(options.directory, "/", name), "the report"});
    }
  }
  return outputs;
}

absl::Status check_outputs(const ReportOptions& options, const std::vector<std::string>& tiers) {
  std::vector<std::string> inputs = files_of(options.server);
  inputs.insert(inputs.end(), options.images.begin(), options.images.end());
  inputs.insert(inputs.end(), options.panoramas.begin(), options.panoramas.end());
  return check_outputs_apart(inputs, outputs_of(options, tiers));
}

absl::StatusOr<ReportImage> cut_to(double megapixels, std::string name, Image image) {
  const uint32_t width = image.width, height = image.height;
  absl::StatusOr<Image> middle = cropped(std::move(image), megapixels);
  if (!middle.ok()) return middle.status();
  const std::string note =
      middle->width == width ? "" : absl::StrFormat(", the middle of %dx%d", width, height);
  return ReportImage{std::move(name), *std::move(middle), note};
}

// The user's images, or the sample scene if there are none, all small enough to be verified.
absl::StatusOr<std::vector<ReportImage>> read_images(const ReportOptions& options, const v1::Limits& limits) {
  const double most = options.quick ? kQuickImageMegapixels : kImageMegapixels;
  std::vector<ReportImage> images;
  for (const std::string& path : options.images) {
    ASSIGN_OR_RETURN(Image image, read_image(path, image_limits(limits, {})));
    ASSIGN_OR_RETURN(ReportImage cut,
                     cut_to(most, std::filesystem::path(path).filename().string(), std::move(image)));
    images.push_back(std::move(cut));
  }
  if (!images.empty()) return images;
  const FrameSize size = frame_size(std::min(most, options.megapixels.back()));
  ASSIGN_OR_RETURN(Image sample, sample_frame(size.width, size.height));
  images.push_back({"sample scene", std::move(sample), ""});
  return images;
}

// The user's panoramas, or the sample panorama if there are none.
absl::StatusOr<std::vector<ReportPanorama>> read_panoramas(const ReportOptions& options,
                                                           const v1::Limits& limits) {
  std::vector<ReportPanorama> panoramas;
  for (const std::string& path : options.panoramas) {
    ASSIGN_OR_RETURN(PanoramaFile file, read_panorama(path, PictureOptions(), limits));
    const std::string name = std::filesystem::path(path).filename().string();
    const bool taken = std::any_of(panoramas.begin(), panoramas.end(),
                                   [&name](const ReportPanorama& other) { return other.name == name; });
    panoramas.push_back({taken ? path : name, std::move(file.panorama)});
  }
  if (!panoramas.empty()) return panoramas;
  const uint32_t height = options.quick ? kQuickPanoramaHeight : kFullPanoramaHeight;
  ASSIGN_OR_RETURN(Image sample, scene_image(2 * height, height, scenes::panorama(2 * height, height)));
  panoramas.push_back({"sample panorama", panorama_of(std::move(sample), v1::Settings())});
  return panoramas;
}

// The load average of the last minute. Read it before anything is measured.
std::string load() {
  double processes = 0;
  if (getloadavg(&processes, 1) != 1) return "unknown";
  return absl::StrFormat("%.2f runnable processes on average in the minute before the run", processes);
}

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    if (absl::StartsWith(line, "model name")) return line.substr(std::min(line.size(), line.find(':') + 2));
  }
  return "unknown";
}

Json machine(const v1::GetServerInfoResponse& info, const ServerChoice& choice, const std::string& load) {
  const v1::DeviceInfo& device = info.device();
  const std::string here =
      absl::StrFormat("%s, %d threads%s", processor(), std::thread::hardware_concurrency(),
                      choice.address.empty() ? "" : " (of the client; the server may run elsewhere)");
  return {{"processor", here},
          {"load", load},
          {"device", device.name()},
          {"kind", absl::StrFormat("%s%s", device.type(),
                                   device.unified_memory() ? ", unified memory" : ", staging copies")},
          {"driver", device.api_version().empty()
                         ? "none"
                         : absl::StrFormat("%s, Vulkan %s", device.driver(), device.api_version())},
          {"passes", device.passes()},
          {"server", choice.address.empty() ? "inside the measuring process" : choice.address},
          {"candela", info.version()}};
}

// A word as a shell takes it.
std::string for_shell(const std::string& word) {
  constexpr char kPlain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-+:,./%@";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  return absl::StrCat("'", absl::StrReplaceAll(word, {{"'", "'\\''"}}), "'");
}

std::string command_of(const ReportOptions& options) {
  std::string command = "candela report DIR";
  if (options.quick) command += " --quick";
  absl::StrAppendFormat(&command, " --megapixels %s", absl::StrJoin(options.megapixels, ","));
  const auto add = [&command](const char* option, const std::vector<std::string>& values) {
    if (!values.empty()) absl::StrAppend(&command, " ", option);
    for (const std::string& value : values) absl::StrAppend(&command, " ", for_shell(value));
  };
  const auto add_one = [&add](const char* option, const std::string& value) {
    if (!value.empty()) add(option, {value});
  };
  add("--images", options.images);
  add("--panoramas", options.panoramas);
  add_one("--server", options.server.address);
  const ClientSecurity& security = options.server.security;
  if (security.tls) command += " --tls";
  add_one("--tls-ca", security.ca_file);
  add_one("--tls-name", security.server_name);
  add_one("--tls-cert", security.cert_file);
  add_one("--tls-key", security.key_file);
  add_one("--token-file", security.token_file);
  add_one("--device", options.server.device);
  add_one("--executor", options.server.executor);
  return command;
}

Json tiers_of(const v1::GetServerInfoResponse& info) {
  Json tiers = Json::array();
  for (const v1::Tier& tier : info.tiers())
    tiers.push_back({{"name", tier.name()}, {"summary", tier.summary()}});
  return tiers;
}

// What the report shows, read or made.
struct Pictures {
  std::vector<ReportImage> images;
  std::vector<ReportPanorama> panoramas;
};

absl::StatusOr<Pictures> read_pictures(const ReportOptions& options, const v1::Limits& limits) {
  ASSIGN_OR_RETURN(std::vector<ReportImage> images, read_images(options, limits));
  ASSIGN_OR_RETURN(std::vector<ReportPanorama> panoramas, read_panoramas(options, limits));
  return Pictures{std::move(images), std::move(panoramas)};
}

// The measurements. The longest ones come last, because --quick may run out of time.
absl::StatusOr<Json> measure(const ReportSession& session, const TimePlan& plan, const Pictures& given,
                             const BakePlan& bake_plan) {
  absl::StatusOr<Json> hard = measure_hard_cases(session);
  if (!hard.ok()) return hard;
  const absl::StatusOr<Json> ingest = measure_ingest(session);
  if (!ingest.ok()) return ingest;
  absl::StatusOr<Json> curves = measure_curves(session);
  if (!curves.ok()) return curves;
  absl::StatusOr<Json> aces = compare_aces(session, given.images);
  if (!aces.ok()) return aces;
  absl::StatusOr<Json> pictures = measure_images(session, given.images, bake_plan.folder);
  if (!pictures.ok()) return pictures;
  ASSIGN_OR_RETURN(Json files, measure_files(session, given.images.front(), bake_plan.folder));
  Json stages = judge_stages(session, {*hard, *curves, *pictures});
  stages.insert(stages.begin(), *ingest);
  ASSIGN_OR_RETURN(EnvironmentRows baked, measure_environments(session, given.panoramas, bake_plan));
  Json scenes = measure_scenes(session, plan);
  Json times = measure_times(session, plan);
  return Json{{"times", std::move(times)},
              {"stage_errors", std::move(stages)},
              {"hard_cases", *std::move(hard)},
              {"curves", *std::move(curves)},
              {"aces", *std::move(aces)},
              {"scenes", std::move(scenes)},
              {"images", *std::move(pictures)},
              {"files", std::move(files)},
              {"environments", std::move(baked.environments)},
              {"bakes", std::move(baked.bakes)}};
}

absl::StatusOr<double> make_report(const ReportOptions& options, Progress& progress) {
  const absl::Time begin = absl::Now();
  const std::string load_before = load();
  NoteDisplay notes(options.quiet);
  ServerLink link(options.server, notes);
  ASSIGN_OR_RETURN(const v1::GetServerInfoResponse info, link.info());
  ASSIGN_OR_RETURN(const Connection* server, link.connection());
  ASSIGN_OR_RETURN(const Pictures given, read_pictures(options, info.limits()));
  const ReportSession session(*server, info, progress);
  RETURN_IF_ERROR(check_outputs(options, session.tiers()));
  const TimePlan plan = time_plan(options, begin);
  const absl::StatusOr<Json> measured =
      measure(session, plan, given, {options.quick, plan.deadline, options.directory});
  if (!measured.ok()) return of_server(measured.status());
  progress.show("writing " + options.directory);
  const double seconds = absl::ToDoubleSeconds(absl::Now() - begin);
  Json report = {{"format", "candela report"},
                 {"version", kFormatVersion},
                 {"command", command_of(options)},
                 {"quick", options.quick},
                 {"date", absl::FormatTime("%Y-%m-%d %H:%M UTC", begin, absl::UTCTimeZone())},
                 {"seconds", seconds},
                 {"machine", machine(info, options.server, load_before)},
                 {"tiers", tiers_of(info)},
                 {"bounded_tier", session.bounded_tier()},
                 {"error_map_scale", error_scale_words()}};
  report.update(*measured);
  RETURN_IF_ERROR(write_report(report, options.directory));
  return seconds;
}

absl::Status run_report(const ReportOptions& options) {
  absl::Status status = check_outputs(options, {});
  if (status.ok()) status = make_folder(options.directory);
  if (!status.ok()) return status;
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  const absl::StatusOr<double> seconds = make_report(options, progress);
  progress.clear();
  if (!seconds.ok()) return seconds.status();
  if (options.quiet) return absl::OkStatus();
  return print(absl::StrFormat(
      "%s/index.html: measured in %.0f s; report.json, the pictures and the tables as CSV are beside it\n",
      options.directory, *seconds));
}

constexpr char kReportExamples[] =
    "Examples:\n"
    "  candela report out --quick\n"
    "  candela report out --images a.exr b.hdr";

Finish define_report(CLI::App& app) {
  const auto options = std::make_shared<ReportOptions>();
  add_report_options(app, *options);
  return [options](const GivenOptions&) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_report_options(*options));
    return parsed_command(*options, run_report);
  };
}

}  // namespace

const Command kReportCommand{"report", "Measures this machine and writes a report page.", kReportExamples,
                             define_report};

}  // namespace candela
