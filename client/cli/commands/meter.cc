// `candela meter`: exposure, statistics and histogram of frames.
#include <CLI/App.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
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
#include "client/cli/options/session_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/render_report.h"
#include "client/cli/run_display.h"
#include "client/cli/stream_report.h"
#include "client/cli/terminal.h"
#include "client/image/read_formats.h"
#include "client/run/options.h"
#include "client/run/output_files.h"
#include "client/run/picture_frame.h"
#include "client/run/run.h"
#include "client/run/server_link.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Defines the options; parsing fills `options`, which outlives the app.
void add_meter_options(CLI::App& app, MeterOptions& options) {
  app.add_option("IN", options.sequence.inputs,
                 absl::StrFormat("An image to meter: %s; or a sequence, as `candela stream` takes it: a "
                                 "folder, files, 'in/*.exr', in/%%04d.exr or in/####.exr",
                                 read_format_names()))
      ->required()
      ->option_text(" ");
  add_session_options(app, options);
  add_choice_options(app, options);
  add_scene_light_option(app, options);
  add_max_pixels_option(app, options);
  add_settings_options(app, options.settings, changes_metering);
  add_curve_options(app, options);
  add_json_option(app, kOutputSection,
                  "Write the numbers as one line of JSON; for a sequence one line a frame, and one for all",
                  options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  add_session_server_options(app, options);
}

// After parsing: refuses options that conflict.
absl::Status finish_meter_options(MeterOptions& options) {
  options.ignore_empty_alpha = options.settings.alpha() == v1::ALPHA_UNSPECIFIED;
  absl::Status status = check_input_names(options.sequence.inputs);
  status.Update(check_settings_options(options.settings));
  status.Update(finish_server_options(options.server));
  return status;
}

// Ends the wait for a server that never answers.
constexpr absl::Duration kMeterTimeout = absl::Minutes(10);
constexpr int kBarCells = 48;

double bin_ev(const v1::MeterResponse& metered, int bin) {
  return metered.histogram_first_ev() + static_cast<double>(bin) / metered.histogram_bins_per_ev();
}

// Sums the bins of each whole EV, from the first EV that is not empty to the last.
std::vector<std::pair<int, double>> by_ev(const v1::MeterResponse& metered) {
  std::vector<std::pair<int, double>> rows;
  if (metered.histogram_bins_per_ev() == 0) return rows;
  for (int bin = 0; bin < metered.histogram_size(); ++bin) {
    const int ev = static_cast<int>(std::floor(bin_ev(metered, bin)));
    if (rows.empty() || rows.back().first != ev) rows.emplace_back(ev, 0);
    rows.back().second += static_cast<double>(metered.histogram(bin));
  }
  const auto filled = [](const std::pair<int, double>& row) { return row.second > 0; };
  rows.erase(std::find_if(rows.rbegin(), rows.rend(), filled).base(), rows.end());
  rows.erase(rows.begin(), std::find_if(rows.begin(), rows.end(), filled));
  return rows;
}

std::string histogram_text(const v1::MeterResponse& metered) {
  const std::vector<std::pair<int, double>> rows = by_ev(metered);
  double all = 0, most = 0;
  for (const auto& [ev, weight] : rows) {
    all += weight;
    most = std::max(most, weight);
  }
  const double mean = metered.statistics().mean_log2_luminance();
  std::string text;
  for (const auto& [ev, weight] : rows) {
    const auto cells = static_cast<size_t>(std::ceil(kBarCells * weight / most));
    absl::StrAppendFormat(&text, "  %+4d EV  %5.1f %% %s%s\n", ev, 100 * weight / all,
                          std::string(cells, '#'), std::floor(mean) == ev ? " <- the mean" : "");
  }
  return text;
}

std::string to_text(const std::string& path, const Image& image, const PrimariesUsed& primaries,
                    const PictureDefaults& defaults, const v1::MeterResponse& metered) {
  const v1::FrameStatistics& statistics = metered.statistics();
  std::string text = absl::StrFormat("%s\n", escaped(path));
  const auto line = [&text](const char* name, const std::string& words) {
    absl::StrAppendFormat(&text, "  %-10s %s\n", name, words);
  };
  line("size", absl::StrFormat("%dx%d", image.width, image.height));
  line("primaries", words_of(primaries));
  line("exposure", absl::StrFormat("%s (%s EV%s), target %s", in_digits(metered.exposure(), 6),
                                   with_sign(std::log2(metered.exposure()), 3),
                                   default_exposure_words(defaults), in_digits(metered.target(), 6)));
  line("luminance", absl::StrFormat("%s .. %s, mean 2^%s", in_digits(statistics.min_luminance(), 4),
                                    in_digits(statistics.max_luminance(), 4),
                                    in_decimals(statistics.mean_log2_luminance(), 3)));
  if (statistics.nan_components() + statistics.infinite_components() + statistics.negative_components() > 0) {
    line("bad values",
         absl::StrFormat("%d NaN, %d infinite, %d negative components", statistics.nan_components(),
                         statistics.infinite_components(), statistics.negative_components()));
  }
  if (statistics.clamped_components() > 0) {
    line("clamped", absl::StrFormat("%d components are beyond 2^30 and were cut to that",
                                    statistics.clamped_components()));
  }
  if (statistics.absent_pixels() > 0) {
    line("absent", absl::StrFormat("%d pixels have alpha 0 and no light; they are not metered",
                                   statistics.absent_pixels()));
  }
  const std::string histogram = histogram_text(metered);
  return text + (histogram.empty() ? "  nothing is metered\n" : histogram);
}

std::string to_json(const std::string& path, const Image& image, const PrimariesUsed& primaries,
                    const v1::MeterResponse& metered) {
  nlohmann::ordered_json json = {{"input", path},
                                 {"size", {{"width", image.width}, {"height", image.height}}},
                                 {"primaries", to_json(primaries)},
                                 {"exposure", metered.exposure()}};
  add_metering(metered, json);
  json.update({{"missing_pixels", image.missing_pixels},
               {"histogram",
                {{"first_ev", metered.histogram_first_ev()},
                 {"bins_per_ev", metered.histogram_bins_per_ev()},
                 {"weights", std::vector<uint64_t>(metered.histogram().begin(), metered.histogram().end())}}},
               {"stage_ms", stages_json(metered)}});
  return line_of(json);
}

// True if the user gave an option that only a sequence or a session has.
bool asks_for_sequence(const MeterOptions& options) {
  const SequenceChoice& sequence = options.sequence;
  return !sequence.range.empty() || sequence.missing != MissingFrames::kError || !sequence.cuts.empty() ||
         sequence.rate || options.lookahead > 0 || options.cut_threshold_ev > 0 || options.skip_bad ||
         options.timeout != absl::InfiniteDuration() || !options.session.empty() || !options.state.empty() ||
         !options.save_exposures.empty() || !options.plot.empty();
}

// A sequence is more than one file, or is asked for something that only a sequence has.
bool is_single_image(const MeterOptions& options) {
  const std::vector<std::string>& inputs = options.sequence.inputs;
  std::error_code ignored;
  return inputs.size() == 1 && !asks_for_sequence(options) && std::filesystem::exists(inputs[0], ignored) &&
         !std::filesystem::is_directory(inputs[0], ignored);
}

absl::Status meter_image(const MeterOptions& options, JsonOutput& json) {
  const std::string& input = options.sequence.inputs.front();
  std::vector<std::string> inputs = files_of(options.server);
  inputs.push_back(input);
  if (absl::Status status = check_outputs_apart(inputs, {{options.json, "the JSON"}}); !status.ok()) {
    return status;
  }
  RETURN_IF_ERROR(json.open());
  Progress progress(!options.quiet);
  RunDisplay display(options.quiet, json, progress);
  display.begins("metering " + input);
  Run run(options, display);
  ASSIGN_OR_RETURN(const v1::Limits limits, run.limits());
  ASSIGN_OR_RETURN(Image image, read_image(input, image_limits(limits, options), choice_of(options)));
  if (options.scene_light) image.light = PictureLight::kScene;
  RETURN_IF_ERROR(run.connect());
  const PictureSettings shown = settings_for(image, options.settings, {.defaults = options.defaults});
  v1::Settings settings = shown.settings;
  const std::string alpha_note = options.ignore_empty_alpha ? ignore_empty_alpha(image, settings) : "";
  absl::StatusOr<v1::MeterResponse> metered;
  const absl::Time deadline = absl::Now() + kMeterTimeout;
  const absl::Status called = run.link().call(deadline, [&](const Connection& one) {
    metered = one.meter(settings, view_of(image), deadline);
    return metered.status();
  });
  progress.clear();
  if (!called.ok()) return name_file(in_options(called, options.settings), input);
  const PrimariesUsed primaries = primaries_used(image, options.settings);
  if (!options.quiet) {
    for (const std::string& note : options.notes) print_note(note);
    for (const std::string& note : image.notes) print_note(note);
    for (const std::string& note :
         {alpha_note, cube_map_note(image), not_metered_note(image, options.settings, shown.defaults),
          held_words(metered->target(), metered->target_before_limits())}) {
      if (!note.empty()) print_note(note);
    }
    if (!json.to_stdout()) {
      RETURN_IF_ERROR(print(to_text(input, image, primaries, shown.defaults, *metered)));
    }
  }
  return json.write(to_json(input, image, primaries, *metered));
}

absl::Status run_meter(const MeterOptions& options, JsonOutput& json) {
  if (!is_single_image(options)) return run_stream(options, json);
  RETURN_IF_ERROR(files_of_inputs(options.sequence.inputs, options.sequence.only).status());
  return about_input(meter_image(options, json), options.sequence.inputs.front());
}

constexpr char kMeterExamples[] =
    "Examples:\n"
    "  candela meter in.exr --percentiles 5,95 --json -\n"
    "  candela meter 'shot/*.exr' --lookahead 4 --detect-cuts --save-exposures shot.json\n"
    "  candela stream 'shot/*.exr' out/%04d.png --range 100-149 --exposures shot.json\n"
    "  candela stream 'shot/*.exr' out/%04d.png --locked-exposure shot.json";

Finish define_meter(CLI::App& app) {
  const auto options = std::make_shared<MeterOptions>();
  add_meter_options(app, *options);
  return [options](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_meter_options(*options));
    add_idle_notes(
        *options,
        {.given = given, .adapts = true, .elapsed_seconds = std::numeric_limits<double>::infinity()});
    return parsed_command(*options, run_meter);
  };
}

}  // namespace

const Command kMeterCommand{
    "meter", "Reports the exposure that metering chooses for an image, or for each frame of a shot, and why.",
    kMeterExamples, define_meter};

}  // namespace candela
