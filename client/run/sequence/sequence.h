// The frames of a sequence: which files they are, their numbers, and which are missing.
//
// A frame's number comes from its file's name and never changes: media time, the names of the images and
// --range go by it. So a gap in the numbers is a gap in time, and a part of a sequence that is rendered alone
// has the numbers and times that it has in the whole.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/frame_rate.h"
#include "client/run/sequence/frame_numbers.h"
#include "client/run/sequence/name_pattern.h"

namespace candela {

// What becomes of numbers without a file.
enum class MissingFrames {
  kError,  // the sequence is refused
  kSkip,   // they have no image
  kHold,   // they have the image of the file before, even if it is not chosen
};

// What the user says about a sequence.
struct SequenceChoice {
  std::vector<std::string> inputs = {};  // files, patterns and folders
  std::vector<NumberRange> range = {};   // empty: from the first file to the last
  MissingFrames missing = MissingFrames::kError;
  std::vector<int64_t> cuts = {};      // numbers of frames that begin a scene, ascending
  std::optional<FrameRate> rate = {};  // without it the first file's, or 24
  // The number at media time 0, if a session's state is continued; without it the first file's.
  std::optional<int64_t> zero = {};
  std::optional<int64_t> after = {};  // the frame after which a session's state is continued
};

struct SequenceFrame {
  int64_t number = 0;
  std::string path;
  bool cut = false;                 // begins a scene
  std::vector<int64_t> holds = {};  // missing numbers that follow it
  uint64_t place = 0;               // of its image among all images, held ones included; 0 for the first
};

struct Sequence {
  std::vector<SequenceFrame> frames;  // the chosen ones; their numbers ascend
  // Missing numbers before the first frame, which repeat a file before them. Without frames, these are all.
  std::vector<int64_t> holds_before;
  std::map<int64_t, std::string> files;  // all files by their numbers, also those that are not chosen
  // The number at media time 0: the choice's, or that of the first file found, even if the range begins
  // later.
  int64_t zero = 0;
  bool cut_after = false;            // a scene begins at a missing number after the last frame
  std::vector<NumberRange> missing;  // chosen numbers without a file
  std::optional<NamePattern> names;  // of the files; without it their names have no number in common
  std::vector<std::string> notes;

  // The first and the last frame's number, or missing number if there is no frame.
  int64_t first() const { return frames.empty() ? holds_before.front() : frames.front().number; }
  int64_t last() const { return frames.empty() ? holds_before.back() : frames.back().number; }
  // A frame's sequence number in a session. It seeds the dither, so it goes by the number, too. It is never
  // negative, because it counts from `zero`.
  uint64_t session_number(size_t index) const { return since_zero(frames[index].number); }
  // The frame with that sequence number, which there must be.
  size_t index_of(uint64_t session_number) const;
  int64_t media_time_ns(int64_t number, FrameRate rate) const {
    return candela::media_time_ns(since_zero(number), rate);
  }

 private:
  uint64_t since_zero(int64_t number) const { return static_cast<uint64_t>(number - zero); }
};

// Finds the files and their numbers, as find_numbered_files() does. Files whose names have no number in
// common are frames 0, 1, 2 ... in the natural order of their names. Notes say this and what is left out.
// NOT_FOUND if an input matches nothing or a frame is missing that may not be; INVALID_ARGUMENT if two files
// have the same number, or a frame lies before the choice's zero, or a cut before it, or without one a cut
// outside of the files. Reads no file.
absl::StatusOr<Sequence> find_sequence(const SequenceChoice& choice);

// The frame rate of a sequence, and where it comes from.
struct ChosenRate {
  FrameRate rate;
  std::string from;  // "--fps", "file", "exposures" or "default"
};

// "24000/1001 fps, from the file"
std::string to_text(const ChosenRate& rate);

// `of_file` is the first file's own rate.
ChosenRate choose_rate(const std::optional<FrameRate>& given, const std::optional<FrameRate>& of_file);

// INVALID_ARGUMENT if the last frame's media time is above 2^62 ns, which is 146 years.
absl::Status check_media_time(const Sequence& sequence, FrameRate rate);

}  // namespace candela
