// The frames of a sequence: the names of their files, their numbers and their times.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/image.h"
#include "client/run/frame_numbers.h"

namespace candela {

// A file's path with a number in its name: frame.%04d.exr, frame.####.exr or frame.@@@@.exr.

struct NamePattern {
  std::string before;  // the path up to the number
  std::string after;   // the rest of the file's name
  int digits = 0;      // of the number, at least; zeros fill them. A minus counts as one: %04d makes -005.
  bool minus_beside = false;  // a minus comes before all of the digits: -0005

  std::string path(int64_t number) const;  // frame.0012.exr
  std::string text() const;                // frame.%04d.exr

  // Whether a file that has a number below 0 in its name is read back with that number: its minus must be a
  // sign, see begins_number().
  bool keeps_sign() const;
};

// Whether a minus at this place of a path or a file's name is a sign: at the name's beginning, and after "."
// or "_". Elsewhere it separates: in shot-1001.exr, 1001 is the number.
bool begins_number(const std::string& path, size_t at);

// Finds the number in the file's name; the folder's name is only text. It is %d or %04d. If there is no %, it
// is a run of # or of @, with as many digits at least: #### is %04d, and a single # or @ is %d. Returns
// nothing if the name has none of them. A usage error for two numbers, and for any other use of %.
absl::StatusOr<std::optional<NamePattern>> parse_name_pattern(const std::string& path);

// The number that stands between the first `before` and the last `after` characters of `text`, a path or a
// file's name. Nothing if that is not a number of 1 .. kMostDigits digits, with a minus only where it is a
// sign.
std::optional<int64_t> number_between(const std::string& text, size_t before, size_t after);

// The frames of a sequence: which files they are, their numbers, and which are missing.
//
// A frame's number comes from its file's name and never changes: media time, the names of the images and
// --range go by it. So a gap in the numbers is a gap in time, and a part of a sequence that is rendered alone
// has the numbers and times that it has in the whole.

// What becomes of numbers without a file.
enum class MissingFrames {
  kError,  // the sequence is refused
  kSkip,   // they have no image
  kHold,   // they have the image of the file before, even if it is not chosen
};

// What the user says about a sequence.
struct SequenceChoice {
  std::vector<std::string> inputs = {};  // files, patterns and folders
  std::vector<std::string> only = {};    // see find_frames()
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
// NOT_FOUND if an input matches nothing or a frame is missing that may not be; INVALID_ARGUMENT if the files
// are of two formats or two have the same number, or a frame lies before the choice's zero, or a cut before
// it, or without one a cut outside of the files. Reads no file.
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

// The files of a sequence: finding the input files and naming the output files.

// Natural order: compares numbers as numbers, so that frame2 comes before frame10 and frame.-2 before
// frame.-1.
bool natural_less(const std::string& a, const std::string& b);

// Files that are no inputs although they are where the inputs are.
struct LeftOut {
  std::vector<std::string> hidden = {};  // images in folders whose names, such as .x, hide them
  std::vector<std::string> others = {};  // files in folders that are no images, or what --only leaves out
};

// "2 hidden files (in/._a.exr ...)", "1 file of another kind (in/notes.txt)", or both; "" if there are none.
std::string words_of(const LeftOut& left_out);

struct FoundFiles {
  std::vector<std::string> paths;  // each file once, in natural order
  LeftOut left_out = {};
};

// Finds the files that the inputs name. An input is a file, a folder, a pattern with * and ?, or a pattern
// with a number (see NamePattern). A file that has a pattern's own name is just that file. A folder is its
// files of the formats that are read, by their extensions; its folders are not looked into. If `only` has
// extensions, in lower case with their dots, files of these alone are taken, whatever names them. NOT_FOUND
// if an input matches nothing.
absl::StatusOr<FoundFiles> find_frames(const std::vector<std::string>& inputs,
                                       const std::vector<std::string>& only = {});

// The number in an input's name. Nothing if it is a folder, a file or a pattern with * and ? instead.
absl::StatusOr<std::optional<NamePattern>> input_pattern(const std::string& input);

// Names the output files of a sequence: by number from a
// pattern, or in a folder by the name of the input file.
class OutputNames {
 public:
  // `output` is a pattern with a number in the file name (see NamePattern), or a folder. Files in a folder
  // get `extension`. A usage error for two numbers, for any other use of % and for the name of a single file.
  static absl::StatusOr<OutputNames> parse(const std::string& output, const std::string& extension);

  bool is_folder() const { return !pattern_; }
  const std::string& extension() const { return extension_; }  // including the dot

  // The path for frame `number`. A folder takes the name of `input`, or
  // the number if it is empty. A pattern ignores `input`.
  std::string path(int64_t number, const std::string& input) const;

  // Whether the pattern gives this path for some number. False of a folder.
  bool may_name(const std::string& path) const;

  // Whether a number below 0 is one for those who read its name (see NamePattern). True of a folder.
  bool keeps_sign() const { return !pattern_ || pattern_->keeps_sign(); }

 private:
  std::optional<NamePattern> pattern_;
  std::string folder_;  // without a pattern
  std::string extension_;
};

}  // namespace candela
