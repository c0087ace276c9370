// Gives the images of a sequence to a sink. With --missing hold, a frame that has no image of its own,
// because its file is missing or bad, is held: it gets the image of the file before it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/run/exposure/shot_exposures.h"
#include "client/run/frames/file_frames.h"
#include "client/run/images/frame_sink.h"
#include "client/run/options.h"
#include "client/run/report.h"
#include "client/run/server/server_link.h"
#include "client/run/stream_plan.h"
#include "client/session.h"

namespace candela {

// How a file that is not part of the sequence is rendered.
struct HeldFrameOptions {
  SessionOptions session;  // those that the sequence's session is opened with
  ImageLimits limits;
  FileFrameOptions files;              // as of the sequence's files
  std::optional<FrameRate> said_rate;  // FileFrames::said_rate()
};

class HeldFrames : public FrameSink {
 public:
  // All but `alone` must outlive this.
  HeldFrames(const StreamOptions& options, const ShotExposures& shot, const StreamPlan& plan,
             HeldFrameOptions alone, ServerLink& link, FrameSink& images, RunSummary& summary);

  // The missing frames before the first file. Call it before the others.
  absl::Status begin() { return repeat_each(sequence_.holds_before.size(), 0); }

  absl::Status image(RunFrame frame, RenderResult image) override;
  absl::Status none(RunFrame frame) override;
  absl::Status finish() override { return images_.finish(); }

 private:
  struct Rendered {
    absl::Status status;  // why the file gives no image
    RenderResult image;
    FrameFacts facts;
  };

  // Whether frames without an image get that of the file before.
  bool holds() const;
  // The missing numbers after the file with this one.
  absl::Status repeat_after(int64_t number);
  // `count` missing numbers, whose images begin at this place.
  absl::Status repeat_each(uint64_t count, uint64_t place);
  // Gives `frame` the image of the last file before it that has one. If that file is not among the chosen
  // ones, it is rendered alone, so that a part of a sequence has the images of the whole. If there is no such
  // file, the frame has no image. frame.status may say why it has none of its own. Fails if images cannot be
  // rendered or written at all, or without --skip-bad for a bad file.
  absl::Status repeat(RunFrame frame);
  absl::StatusOr<Rendered> render_alone(int64_t number, const std::string& path);
  GivenExposures exposures_of(int64_t number) const;

  const StreamOptions& options_;
  const ShotExposures& shot_;
  const Sequence& sequence_;
  const std::vector<NamedImage>& named_;
  HeldFrameOptions alone_;
  ServerLink& link_;
  FrameSink& images_;
  RunSummary& summary_;
  std::string image_of_;  // the file whose image is the last one; "": there is none
  // Files with smaller numbers are not worth a try: they are image_of_, come before it or are bad.
  int64_t next_ = -kLargestFrameNumber;
};

}  // namespace candela
