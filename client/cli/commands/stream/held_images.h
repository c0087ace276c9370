// The images of frames that have none of their own and repeat the image of the file before: missing frames,
// and bad ones beside --skip-bad.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/commands/server_link.h"
#include "client/cli/commands/stream/shot_exposures.h"
#include "client/cli/commands/stream/stream_images.h"
#include "client/cli/commands/stream/stream_report.h"
#include "client/cli/files/sequence/frame_feeder.h"
#include "client/cli/files/sequence/sequence.h"
#include "client/cli/options/options.h"
#include "client/session.h"

namespace candela {

// Used by one thread. Tell it of every frame, in the order of their numbers.
class HeldImages {
 public:
  // All of them must outlive this.
  HeldImages(const StreamOptions& options, const ShotExposures& shot, const Sequence& sequence,
             ServerLink& link, StreamImages& images, StreamSummary& summary)
      : options_(options),
        shot_(shot),
        sequence_(sequence),
        link_(link),
        images_(images),
        summary_(summary) {}

  // Call it first. `session` has the options that the sequence's session is opened with, `feed` those with
  // which `feeder` feeds it, and `feeder` knows the frame rate.
  void begin(SessionOptions session, const ImageLimits& limits, FeedOptions feed, const FrameFeeder& feeder);

  // The last image is that of the file with this number.
  void has_image(int64_t number, const std::string& path);
  // The file with this number gives no image.
  void has_none(int64_t number) { next_ = number + 1; }

  // Gives `frame` the image of the last file before it that has one, and puts it into the list of images. If
  // that file is not among the chosen ones, it is rendered alone, so that a part of a sequence has the images
  // of the whole. If there is no such file, the frame has no image. frame.status may say why it has none of
  // its own. Fails if images cannot be rendered or written at all, or without --skip-bad for a bad file.
  absl::Status repeat(StreamFrame frame);

 private:
  struct Rendered {
    absl::Status status;  // why the file gives no image
    RenderResult image;
    FrameFacts facts;
  };
  absl::StatusOr<Rendered> render_alone(int64_t number, const std::string& path);
  GivenExposures exposures_of(int64_t number) const;

  const StreamOptions& options_;
  const ShotExposures& shot_;
  const Sequence& sequence_;
  ServerLink& link_;
  StreamImages& images_;
  StreamSummary& summary_;
  SessionOptions session_;
  ImageLimits limits_;
  FeedOptions feed_;
  std::optional<FrameRate> said_rate_;
  std::string image_of_;  // the file whose image is the last one; "": there is none
  // Files with smaller numbers are not worth a try: they are image_of_, come before it or are bad.
  int64_t next_ = -kLargestFrameNumber;
};

}  // namespace candela
