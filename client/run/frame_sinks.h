// Where the images of a run go: into files, or into a pipe or a film.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/image.h"
#include "client/image/write/piped_frames.h"
#include "client/render_result.h"
#include "client/run/events.h"
#include "client/run/film.h"
#include "client/run/report.h"
#include "client/run/session_run.h"

namespace candela {

// Writes the images of a run as files, several at once, and reports them in the order of the frames.
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

// Writes the frames of a run to standard output or to a film's encoder, one after another.
class FramePipe : public FrameSink {
 public:
  // It counts the frames in `summary`. `film` is null for standard output; its owner finishes it. With
  // `even`, frames must have even sizes. With `verbose`, a note says a y4m's matrix. All references must
  // outlive this.
  FramePipe(PipeFormat format, FrameRate rate, FilmFile* film, bool even, bool verbose, RunEvents& events,
            RunSummary& summary)
      : format_(format),
        rate_(rate),
        film_(film),
        even_(even),
        verbose_(verbose),
        events_(events),
        summary_(summary) {}

  // Returns when the frame is written. Fails if nobody reads any more; of standard output summary.reader_left
  // is set then. A film's frames must have the size of the first.
  absl::Status image(RunFrame frame, RenderResult image) override;
  // Writes the last image again if the frame is held; leaves out any other frame.
  absl::Status none(RunFrame frame) override;
  absl::Status finish() override { return absl::OkStatus(); }

 private:
  absl::Status begin_film(const RunFrame& frame);
  absl::Status write(const void* bytes, size_t count);
  absl::Status tell(RunFrame frame);

  const PipeFormat format_;
  const FrameRate rate_;
  FilmFile* const film_;
  const bool even_, verbose_;
  RunEvents& events_;
  RunSummary& summary_;
  uint32_t width_ = 0, height_ = 0;  // of the first frame; 0: there was none
  std::vector<std::byte> bytes_;     // the last frame's
};

}  // namespace candela
