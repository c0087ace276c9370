// A film's file, written by ffmpeg.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/write/atomic_file.h"

namespace candela {

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
