#include <OpenEXR/ImfThreading.h>

#include <algorithm>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/render_report.h"
#include "client/cli/commands/server_link.h"
#include "client/cli/files/error_map.h"
#include "client/cli/files/frame_files.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "client/image/image.h"

namespace candela {
namespace {

// Ends the wait for a server that never answers. The largest frame behind a full queue takes much less time.
constexpr absl::Duration kRenderTimeout = absl::Minutes(30);

double ms_since(absl::Time begin) { return absl::ToDoubleMilliseconds(absl::Now() - begin); }

// Renders one file: reads it, has the server render it, and writes the result.
class Rendering {
 public:
  Rendering(const RenderOptions& options, Progress& progress)
      : options_(options), progress_(progress), link_(options.server) {}

  absl::StatusOr<RenderReport> run() {
    report_.input = options_.input;
    report_.output = options_.output;
    report_.error_map = options_.error_map;
    report_.metered = options_.settings.exposure().mode() != v1::Exposure::MODE_MANUAL;
    report_.notes = options_.notes;
    if (absl::Status status = bake(); !status.ok()) return status;
    absl::StatusOr<Image> image = read();
    if (!image.ok()) return image.status();
    absl::StatusOr<Image> picture = render(*std::move(image));
    if (!picture.ok()) return picture.status();
    if (absl::Status status = write(*picture); !status.ok()) return status;
    if (absl::Status status = write_error_map(); !status.ok()) return status;
    report_.total_ms = ms_since(begin_);
    return std::move(report_);
  }

 private:
  // Bakes the view of --ocio, if it is set, into a table.
  absl::Status bake() {
    if (options_.view.config.empty()) return absl::OkStatus();
    progress_.show("baking " + options_.view.config);
    const absl::Time begin = absl::Now();
    absl::StatusOr<BakedView> baked = candela::bake(options_.view);
    if (!baked.ok()) return baked.status();
    table_ = std::move(baked->table);
    report_.view = std::move(baked->report);
    add_notes(std::move(baked->notes));
    bake_ms_ = ms_since(begin);
    return absl::OkStatus();
  }

  absl::StatusOr<Image> read() {
    progress_.show("reading " + options_.input);
    const absl::StatusOr<v1::Limits> limits = link_.limits();
    if (!limits.ok()) return limits.status();
    const absl::Time begin = absl::Now();
    absl::StatusOr<Image> image = read_image(
        options_.input, {.max_dimension = limits->max_dimension(), .max_bytes = limits->max_frame_bytes()});
    read_ms_ = ms_since(begin);
    if (!image.ok()) return image;
    add_notes(std::exchange(image->notes, {}));
    absl::Status status = check_view_input(*image, options_.input, options_.settings, options_.view);
    if (!status.ok()) return status;
    return image;
  }

  // Frees the frame and stops the built-in server before it
  // returns, so that only the picture stays in memory.
  absl::StatusOr<Image> render(Image frame) {
    progress_.show("rendering " + options_.input);
    const absl::StatusOr<const Connection*> server = link_.connection();
    if (!server.ok()) return server.status();
    if (absl::Status status = link_.check_tier(options_.settings.tier()); !status.ok()) return status;
    const absl::Time begin = absl::Now();
    FrameView view = view_of(frame);
    if (options_.previous.exposure() > 0) view.previous = options_.previous;
    view.verify = options_.verify;
    view.error_map = !options_.error_map.empty();
    view.on_sent = [&frame] { frame.pixels = {}; };  // the picture will need the memory
    v1::Settings settings = settings_for(frame, options_.settings);
    if (table_.size() != 0) *settings.mutable_table() = std::move(table_);
    absl::StatusOr<RenderResult> result = (*server)->render(settings, view, begin + kRenderTimeout);
    const double call_ms = ms_since(begin);
    if (!result.ok()) return name_file(result.status(), options_.input);
    link_.close();

    report_.header = result->header;
    error_map_ = std::move(result->error_map);
    add_stages(call_ms);
    return picture_of(*result, frame.has_alpha, frame.pixel_aspect);
  }

  absl::Status write(const Image& picture) {
    progress_.show("writing " + options_.output);
    const absl::Time begin = absl::Now();
    absl::StatusOr<std::vector<std::string>> notes = write_image(options_.output, picture, options_.write);
    if (!notes.ok()) return notes.status();
    report_.stage_ms.emplace_back("write", ms_since(begin));
    add_notes(*std::move(notes));
    return absl::OkStatus();
  }

  absl::Status write_error_map() {
    if (options_.error_map.empty()) return absl::OkStatus();
    progress_.show("writing " + options_.error_map);
    const absl::StatusOr<Image> map =
        draw_error_map(error_map_, report_.header.width(), report_.header.height());
    if (!map.ok()) return map.status();
    return write_image(options_.error_map, *map, {.text = {{"Description", error_scale_words()}}}).status();
  }

  void add_notes(std::vector<std::string> notes) {
    std::move(notes.begin(), notes.end(), std::back_inserter(report_.notes));
  }

  void add_stages(double call_ms) {
    if (link_.start_ms() > 0) report_.stage_ms.emplace_back("start", link_.start_ms());
    if (report_.view) report_.stage_ms.emplace_back("view", bake_ms_);
    report_.stage_ms.emplace_back("read", read_ms_);
    double server_ms = 0;
    for (const v1::StageTime& stage : report_.header.stages()) {
      const double ms = static_cast<double>(stage.ns()) * 1e-6;
      report_.stage_ms.emplace_back(stage.name(), ms);
      server_ms += ms;
    }
    report_.stage_ms.emplace_back("other", std::max(0.0, call_ms - server_ms));
  }

  const absl::Time begin_ = absl::Now();
  const RenderOptions& options_;
  Progress& progress_;
  ServerLink link_;
  RenderReport report_;
  std::vector<uint16_t> error_map_;
  v1::ColorTable table_;  // size 0 if there is no view
  double bake_ms_ = 0;
  double read_ms_ = 0;
};

}  // namespace

absl::Status run_render(const RenderOptions& options) {
  for (const std::string& path : {options.output, options.error_map}) {
    if (path.empty()) continue;
    if (const auto kind = check_output_path(path); !kind.ok()) return kind.status();
  }
  absl::StatusOr<JsonOutput> json = JsonOutput::open(options.json);
  if (!json.ok()) return json.status();
  Progress progress(!options.quiet);
  Rendering rendering(options, progress);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  const absl::StatusOr<RenderReport> report = rendering.run();
  progress.clear();
  if (!report.ok()) return report.status();
  if (!options.quiet) {
    for (const std::string& note : report->notes) print_note(note);
    if (!json->to_stdout()) {
      if (absl::Status status = print(to_text(*report)); !status.ok()) return status;
    }
  }
  return json->write(to_json(*report));
}

}  // namespace candela
