// Writes the images of `candela stream`, several at once, and reports them in the order of the frames.
#pragma once

#include <cstdint>
#include <deque>
#include <future>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/commands/stream_report.h"
#include "client/cli/files/frame_feeder.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "client/image/image.h"
#include "client/render_result.h"

namespace candela {

// Used by one thread.
class StreamImages {
 public:
  // All of them must outlive this.
  StreamImages(const WriteOptions& options, bool quiet, JsonOutput& json, Progress& progress,
               StreamSummary& summary)
      : options_(options), quiet_(quiet), json_(json), progress_(progress), summary_(summary) {}

  // Begins to write the image to frame.output. `holds` are the missing frames that repeat it: they get the
  // same bytes. Waits while too many images are being written. Returns an error if writing one of them
  // failed.
  absl::Status write(StreamFrame frame, RenderResult image, const FrameFacts& facts,
                     std::vector<StreamFrame> holds);

  // A frame without an image: frame.status says why. The frames that would repeat it have none either.
  absl::Status skip(StreamFrame frame, std::vector<StreamFrame> holds);

  // Waits until all images are written.
  absl::Status finish();

 private:
  struct Entry {
    StreamFrame frame;
    std::vector<StreamFrame> holds;
    std::future<absl::StatusOr<std::vector<std::string>>> written;  // invalid if there is no image
  };

  absl::Status keep_bounded();
  absl::Status finish_oldest();
  absl::Status finish_written(Entry& entry);
  absl::Status finish_skipped(Entry& entry);

  const WriteOptions& options_;
  const bool quiet_;
  JsonOutput& json_;
  Progress& progress_;
  StreamSummary& summary_;
  std::deque<Entry> entries_;
};

}  // namespace candela
