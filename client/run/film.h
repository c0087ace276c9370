// Films, which ffmpeg makes.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/write/atomic_file.h"
#include "client/image/write/piped_frames.h"
#include "server/encode/picture.h"

namespace candela {

// The films that ffmpeg makes: which codecs there are, which files hold them, and ffmpeg's command line.

struct FilmCodec {
  const char* word;                     // "h264"
  std::vector<std::string> extensions;  // of the files that hold it: ".mp4"
  bool deep;                            // always of 10 bits
  std::vector<std::string> options;     // ffmpeg's, with a named preset
};

struct FilmFormat {
  const FilmCodec* codec = nullptr;
  std::string extension;     // ".mp4", in lower case
  bool full_chroma = false;  // 4:4:4; else 4:2:0, or 4:2:2 of ProRes, which need even sizes
  int bits = 8;              // 8 or 10
};

// "--codec"'s words, the default first.
std::vector<std::string> film_codecs();

// ".mp4, .mov, .mkv or .webm".
std::string film_extensions();

// The extension of a film's file in lower case; "" for another file.
std::string film_extension(const std::string& path);

// The format of a film for `path`, whose extension is a film's. `codec` is a word or "", then it is the one
// that the file usually holds. `bits` is 0 for the codec's usual depth. A usage error says what does not go
// together, and what does.
absl::StatusOr<FilmFormat> film_format(const std::string& path, const std::string& codec, bool full_chroma,
                                       int bits);

// What ffmpeg gets on its standard input, where the user asked for the chroma and matrix of `asked`. ProRes
// of 4:2:2 is made from 4:4:4.
PipeFormat piped_for(const FilmFormat& film, PipeFormat asked);

// ffmpeg and its arguments, for a film with this transfer that is written to `output`. Frames are tagged with
// the primaries of Rec.709, unless the transfer is unknown as that of an OpenColorIO view, and with the
// matrix and range of a y4m. With PQ and HLG the primaries are those of `hdr`, and an HEVC in PQ says which
// display it is made for.
std::vector<std::string> film_command(const FilmFormat& film, EncodedTransfer transfer, const HdrDisplay& hdr,
                                      const std::string& output);

// A film's file, written by ffmpeg.
//
// ffmpeg writes into a temporary file beside the film's, as AtomicFile does. It gets the file as a descriptor
// and not by name, so that it cannot make the file again after a signal has removed it. One at a time in a
// process; used by one thread.
class FilmFile {
 public:
  // Starts ffmpeg from the PATH with `command`, in which the file's name is kOutput. Fails if it is not
  // installed, or as AtomicFile::create().
  static absl::StatusOr<std::unique_ptr<FilmFile>> open(const std::string& path,
                                                        const std::vector<std::string>& command);
  ~FilmFile();  // without finish(): ends ffmpeg, and there is no film
  FilmFile(const FilmFile&) = delete;

  static constexpr char kOutput[] = "/proc/self/fd/3";

  const std::string& path() const { return file_.path(); }

  // Gives bytes to ffmpeg's standard input. If ffmpeg has ended, fails with its last words.
  absl::Status write(const void* bytes, size_t count);

  // Waits until ffmpeg has made the film, and gives it its name. Call it once.
  absl::Status finish();

  // Ends the ffmpeg of this process, which must end next. Async-signal-safe.
  static void end_encoder();

 private:
  FilmFile(AtomicFile file, pid_t encoder, int frames, int words)
      : file_(std::move(file)), encoder_(encoder), frames_(frames), words_(words) {}

  // Waits until ffmpeg can read frames or has written messages. Adds its messages to said_. Returns whether
  // it can read frames.
  bool takes_frames();
  absl::Status wait_for_encoder();
  absl::Status failure(int ended) const;

  AtomicFile file_;
  pid_t encoder_;     // 0: it has ended
  int frames_;        // its standard input; -1: closed
  int words_;         // its standard error; -1: it has ended
  std::string said_;  // the last of its words
};

}  // namespace candela
