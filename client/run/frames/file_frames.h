// The frames of a sequence of files, or of a pipe.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/image/image.h"
#include "client/run/exposure/exposure_file.h"
#include "client/run/frames/frame_reader.h"
#include "client/run/frames/frame_source.h"
#include "client/run/picture/baked_view.h"
#include "client/run/sequence/sequence.h"

namespace candela {

// Options of the frames that files become.
struct FileFrameOptions {
  v1::Settings settings;                              // without a table
  absl::Duration timeout = absl::InfiniteDuration();  // of a frame on the server
  bool skip_bad = false;                              // files that cannot be read do not end it
  std::optional<FrameRate> rate = {};                 // --fps
  std::shared_ptr<const BakedView> view = {};         // of --ocio; null without it
  bool ignore_empty_alpha = false;                    // as in PictureOptions
  bool desqueeze = false;                             // as there
  GivenExposures exposures = {};                      // of the frames, by their numbers
};

class FileFrames : public FrameSource {
 public:
  // `reader` reads the sequence's frames. It and the sequence must outlive this.
  FileFrames(const Sequence& sequence, FileFrameOptions options, FrameReader& reader)
      : sequence_(sequence),
        options_(std::move(options)),
        reader_(reader),
        rate_(choose_rate(options_.rate, std::nullopt)) {}

  // Reads up to the first file that can be read. Call it first. Fails for a file that cannot, unless bad ones
  // are skipped, and if the last frame's media time is too large.
  absl::Status open();

  // Valid after open(). The first file that can be read may say it; it may come before the first frame.
  const ChosenRate& rate() const { return rate_; }
  // The same; nothing if it is only the default.
  const std::optional<FrameRate>& said_rate() const { return said_rate_; }

  uint64_t frames() const override { return reader_.frames(); }
  std::optional<SourceFrame> next() override;
  void stop() override { reader_.stop(); }

 private:
  void decide_rate(const FrameReader::Read* first);
  // Makes the frame of the image. Says why there is none.
  absl::Status make(absl::StatusOr<Image> read, const SequenceFrame& file, SourceFrame& made);
  void add_notes(const Image& image, const std::string& path, std::vector<std::string>& notes);

  const Sequence& sequence_;
  const FileFrameOptions options_;
  FrameReader& reader_;
  ChosenRate rate_;
  std::optional<FrameRate> said_rate_;   // nothing if rate_ is the default
  std::deque<FrameReader::Read> read_;   // by open(), and not yet returned
  std::vector<std::string> rate_notes_;  // for the first frame
  // The first file that could be read.
  std::string first_path_;
  uint32_t first_width_ = 0, first_height_ = 0;
  bool size_differs_ = false, rate_differs_ = false;
  bool begins_scene_ = false;  // a frame that was to begin a scene was skipped, so the next one begins it
};

}  // namespace candela
