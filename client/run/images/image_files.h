// Writes the images of a run as files, several at once, and reports them in the order of the frames.
#pragma once

#include <deque>
#include <functional>
#include <future>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/image.h"
#include "client/render_result.h"
#include "client/run/events.h"
#include "client/run/images/frame_sink.h"
#include "client/run/report.h"

namespace candela {

class ImageFiles : public FrameSink {
 public:
  // Names a frame's file; "" for frames that are only metered.
  using OutputOf = std::function<std::string(const FrameFacts&)>;

  // It counts the frames in `summary`. All references must outlive this.
  ImageFiles(OutputOf output_of, const WriteOptions& options, RunEvents& events, RunSummary& summary)
      : output_of_(std::move(output_of)), options_(options), events_(events), summary_(summary) {}

  // Begins to write the image. Waits while too many images are being written. Returns an error if writing one
  // of them failed.
  absl::Status image(RunFrame frame, RenderResult image) override;
  absl::Status none(RunFrame frame) override { return add({std::move(frame), {}}); }
  absl::Status finish() override;

 private:
  struct Entry {
    RunFrame frame;
    std::future<absl::StatusOr<std::vector<std::string>>> written;  // invalid if no image was rendered
  };

  absl::Status add(Entry entry);
  absl::Status finish_oldest();

  const OutputOf output_of_;
  const WriteOptions& options_;
  RunEvents& events_;
  RunSummary& summary_;
  std::deque<Entry> entries_;
  std::string last_;  // the image that was written last
};

}  // namespace candela
