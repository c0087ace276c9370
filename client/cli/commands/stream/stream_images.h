// Writes the images of `candela stream`, several at once, and reports them in the order of the frames.
#pragma once

#include <cstdint>
#include <deque>
#include <future>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/commands/stream/stream_report.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/sequence/frame_feeder.h"
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

  // Begins to write the image to frame.output. Waits while too many images are being written. Returns an
  // error if writing one of them failed.
  absl::Status write(StreamFrame frame, RenderResult image, const FrameFacts& facts);

  // The frame gets the same bytes as the image before it, which there must be.
  absl::Status repeat(StreamFrame frame);

  // A frame without an image: frame.status says why.
  absl::Status skip(StreamFrame frame);

  // Waits until all images are written.
  absl::Status finish();

 private:
  struct Entry {
    StreamFrame frame;
    std::future<absl::StatusOr<std::vector<std::string>>> written;  // invalid if no image was rendered
  };

  absl::Status add(Entry entry);
  absl::Status finish_oldest();
  void count(const StreamFrame& frame);

  const WriteOptions& options_;
  const bool quiet_;
  JsonOutput& json_;
  Progress& progress_;
  StreamSummary& summary_;
  std::deque<Entry> entries_;
  std::string last_;  // the image that was written last
};

}  // namespace candela
