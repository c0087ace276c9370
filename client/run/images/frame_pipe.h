// Writes the frames of a run to standard output or to a film's encoder, one after another.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "client/image/frame_rate.h"
#include "client/image/write/piped_frames.h"
#include "client/render_result.h"
#include "client/run/events.h"
#include "client/run/images/film_file.h"
#include "client/run/images/frame_sink.h"
#include "client/run/report.h"

namespace candela {

class FramePipe : public FrameSink {
 public:
  // It counts the frames in `summary`. `film` is null for standard output; its owner finishes it. With
  // `even`, frames must have even sizes. All references must outlive this.
  FramePipe(PipeFormat format, FrameRate rate, FilmFile* film, bool even, RunEvents& events,
            RunSummary& summary)
      : format_(format), rate_(rate), film_(film), even_(even), events_(events), summary_(summary) {}

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
  const bool even_;
  RunEvents& events_;
  RunSummary& summary_;
  uint32_t width_ = 0, height_ = 0;  // of the first frame; 0: there was none
  std::vector<std::byte> bytes_;     // the last frame's
};

}  // namespace candela
