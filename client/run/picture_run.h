// Renders one picture: of a file, or of a view.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "client/image/image.h"
#include "client/render_result.h"
#include "client/run/events.h"
#include "client/run/options.h"
#include "client/run/report.h"
#include "client/run/run.h"
#include "server/encode/gain_map.h"

namespace candela {

// The run of a picture that one call renders: of a frame, or of a panorama's view.
//
// Collects the report and writes the files. Whoever owns it reads, connects and calls. Used by one thread.
class PictureRun {
 public:
  // `run` has its exposure and its view. All but the paths must outlive this. report().total_ms counts from
  // `begin`.
  PictureRun(const RunOptions& options, const VerifyChoice& verify, const std::string& input,
             const std::string& output, const Run& run, RunEvents& events, absl::Time begin);

  RenderReport& report() { return report_; }
  void add_note(std::string note);
  void add_notes(std::vector<std::string> notes);
  void add_stage(const std::string& name, double ms) { report_.stage_ms.emplace_back(name, ms); }

  // How the picture is sent. Call it before take().
  void show(const PictureSettings& made);

  // The call's result, but its pixels. `settings` are those that were sent, for a frame of this size.
  void take(RenderResult& result, const v1::Settings& settings, v1::ImageSize frame);

  // Sets the JPEG's gain map, which replaces one in the picture's fourth component.
  void set_gain_map(GainMapCodes map) {
    report_.gain_map = std::make_shared<const GainMapCodes>(std::move(map));
  }

  absl::Status write(const Image& picture);
  absl::Status write_error_map() const;
  RenderReport finish();

 private:
  const absl::Time begin_;
  const RunOptions& options_;
  const VerifyChoice& verify_;
  const Run& run_;
  RunEvents& events_;
  RenderReport report_;
  std::optional<std::array<float, 8>> kept_primaries_;  // of the image
  std::vector<uint16_t> error_map_;
};

// The run of one image file: read, rendered by one call, and written.

// One image to render: a file in, a file out.
struct RenderJob {
  std::string input;
  std::string output;
  std::function<void(Image)> take = nullptr;  // gets the image in place of a file
};

// Reads the input, has the server render it, and writes the output. Several threads may call it with one
// `run`. `only` says that no other image follows: the server is stopped before the image is written.
absl::StatusOr<RenderReport> run_frame(const RenderOptions& options, const RenderJob& job, bool only,
                                       Run& run, RunEvents& events);

}  // namespace candela
