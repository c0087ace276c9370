// Frames of files or of a pipe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/image/image.h"
#include "client/image/read/image_stream.h"
#include "client/run/baked_view.h"
#include "client/run/exposure_file.h"
#include "client/run/frame_source.h"
#include "client/run/sequence.h"

namespace candela {

// Gives images in order: of files, read ahead, several at once; or of a pipe.

// Used by one thread at a time.
class FrameReader {
 public:
  virtual ~FrameReader() = default;

  struct Read {
    size_t index;  // of its frame in the sequence
    absl::StatusOr<Image> image;
  };
  // Waits for the next image in order. Returns nothing after the last.
  virtual std::optional<Read> next() = 0;

  // Their number; 0 if it is not known.
  virtual uint64_t frames() const = 0;

  // Reads a file that is none of the frames.
  virtual absl::StatusOr<Image> read(const std::string& path) const = 0;

  // next() returns nothing more, also if it waits. Any thread.
  virtual void stop() {}
};

class FileFrameReader : public FrameReader {
 public:
  // Holds at most `ahead` (at least 1) images that next() has not returned yet.
  FileFrameReader(std::vector<std::string> paths, const ImageLimits& limits, size_t ahead,
                  PictureChoice choice = {});

  std::optional<Read> next() override;
  uint64_t frames() const override { return paths_.size(); }
  absl::StatusOr<Image> read(const std::string& path) const override {
    return read_image(path, limits_, choice_);
  }

 private:
  void read_ahead();

  const std::vector<std::string> paths_;
  const ImageLimits limits_;
  const PictureChoice choice_;
  const size_t ahead_;
  size_t at_ = 0;  // the next file to start reading
  std::deque<std::future<absl::StatusOr<Image>>> reading_;
};

// Reads standard input.
class PipedFrameReader : public FrameReader {
 public:
  // Adds each frame to the sequence as it comes; its number follows that of the frame before. The first is
  // `first`. `cuts` are the numbers of frames that begin a scene, ascending. The sequence must outlive this.
  PipedFrameReader(Sequence& sequence, int64_t first, std::vector<int64_t> cuts, const ImageLimits& limits,
                   PictureChoice choice);

  std::optional<Read> next() override;
  uint64_t frames() const override { return 0; }
  absl::StatusOr<Image> read(const std::string& path) const override;
  void stop() override { stream_.stop(); }

  // Why what follows the last frame cannot be read. Call it after the last next().
  const absl::Status& lost() const { return stream_.lost(); }

 private:
  Sequence& sequence_;
  int64_t number_;
  const std::vector<int64_t> cuts_;
  ImageStream stream_;
};

// The frames of a sequence of files, or of a pipe.

// Options of the frames that files become.
struct FileFrameOptions {
  v1::Settings settings;                              // without a table
  absl::Duration timeout = absl::InfiniteDuration();  // of a frame on the server
  bool skip_bad = false;                              // files that cannot be read do not end it
  std::optional<FrameRate> rate = {};                 // --fps
  std::shared_ptr<const BakedView> view = {};         // of --ocio; null without it
  bool ignore_empty_alpha = false;                    // as in PictureOptions
  bool desqueeze = false;                             // as there, and the next three
  bool scene_light = false;
  bool names_primaries = false;
  PictureDefaults defaults = {};
  GivenExposures exposures = {};  // of the frames, by their numbers
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
