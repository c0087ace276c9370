// Writes the images of a run as files, several at once, and reports them in the order of the frames.
#pragma once

#include <deque>
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
  // `outputs` are the files by the frames' places; "" for frames that are only metered. It counts the frames
  // in `summary`. All of them must outlive this.
  ImageFiles(std::vector<std::string> outputs, const WriteOptions& options, RunEvents& events,
             RunSummary& summary)
      : outputs_(std::move(outputs)), options_(options), events_(events), summary_(summary) {}

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

  const std::string& output_of(const RunFrame& frame) const { return outputs_.at(frame.facts.place); }
  absl::Status add(Entry entry);
  absl::Status finish_oldest();
  void count(const RunFrame& frame);

  const std::vector<std::string> outputs_;
  const WriteOptions& options_;
  RunEvents& events_;
  RunSummary& summary_;
  std::deque<Entry> entries_;
  std::string last_;  // the image that was written last
};

}  // namespace candela
