#include "client/run/film.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <iterator>
#include <optional>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/base/failure.h"
#include "client/image/read_formats.h"
#include "server/base/status_macros.h"
#include "server/encode/color_words.h"

namespace candela {
namespace {

// A file and ffmpeg's name for its kind.
struct FilmContainer {
  const char* extension;
  const char* muxer;
  const char* usual;  // the codec
  bool is_quicktime;  // an index that can stand first, and Apple's word for HEVC
};
constexpr FilmContainer kContainers[] = {{".mp4", "mp4", "h264", true},
                                         {".mov", "mov", "h264", true},
                                         {".mkv", "matroska", "h264", false},
                                         {".webm", "webm", "av1", false}};

// libaom and not SVT-AV1: that of Debian 12 hangs if ffmpeg fails.
const FilmCodec kCodecs[] = {
    {"h264", {".mp4", ".mov", ".mkv"}, false, {"-c:v", "libx264", "-preset", "medium", "-crf", "18"}},
    {"hevc", {".mp4", ".mov", ".mkv"}, false, {"-c:v", "libx265", "-preset", "medium", "-crf", "20"}},
    {"av1",
     {".mp4", ".mkv", ".webm"},
     false,
     {"-c:v", "libaom-av1", "-cpu-used", "6", "-row-mt", "1", "-crf", "24"}},
    {"prores", {".mov", ".mkv"}, true, {"-c:v", "prores_ks", "-vendor", "apl0"}},
};

const FilmContainer* container_of(const std::string& extension) {
  const auto* const found = std::ranges::find(kContainers, extension, &FilmContainer::extension);
  return found == std::end(kContainers) ? nullptr : found;
}

const char* trc_of(EncodedTransfer transfer) {
  switch (transfer) {
    case EncodedTransfer::kSrgb:
      return "iec61966-2-1";
    case EncodedTransfer::kGamma22:
      return "bt470m";
    case EncodedTransfer::kLinear:
      return "linear";
    case EncodedTransfer::kPq:
      return "smpte2084";
    case EncodedTransfer::kHlg:
      return "arib-std-b67";
    case EncodedTransfer::kUnknown:
      break;
  }
  return "unknown";
}

// An HDR film's primaries decide its matrix, too.
const char* primaries_of(EncodedTransfer transfer, const HdrDisplay& hdr) {
  if (is_hdr(transfer)) return hdr.p3 ? "smpte432" : "bt2020";
  return transfer == EncodedTransfer::kUnknown ? "unknown" : "bt709";
}

const char* matrix_of(EncodedTransfer transfer, const HdrDisplay& hdr) {
  return is_hdr(transfer) && !hdr.p3 ? "bt2020nc" : "bt709";
}

std::string point_words(const char* name, DisplayPoint point) {
  return absl::StrFormat("%s(%d,%d)", name, point[0], point[1]);
}

// What ffmpeg has no option for. The light levels (max-cll) are not known before the film is made.
std::string x265_params(EncodedTransfer transfer, const HdrDisplay& hdr) {
  std::string params = "log-level=error";
  if (transfer != EncodedTransfer::kPq) return params;
  const DisplayPoints points = display_points(hdr);
  return params + ":hdr10=1:repeat-headers=1:master-display=" + point_words("G", points.green) +
         point_words("B", points.blue) + point_words("R", points.red) + point_words("WP", points.white) +
         absl::StrFormat("L(%d,1)", luminance_units(hdr.peak_nits));  // H.265 knows no least luminance of 0
}

std::string pixels_of(const FilmFormat& film) {
  const char* chroma = film.full_chroma ? "444" : film.codec->deep ? "422" : "420";
  return absl::StrFormat("yuv%sp%s", chroma, film.bits > 8 ? "10le" : "");
}

}  // namespace

std::vector<std::string> film_codecs() {
  std::vector<std::string> words;
  for (const FilmCodec& codec : kCodecs) words.emplace_back(codec.word);
  return words;
}

std::string film_extensions() {
  std::vector<std::string> words;
  for (const FilmContainer& container : kContainers) words.emplace_back(container.extension);
  return one_of(words);
}

std::string film_extension(const std::string& path) {
  std::string extension = extension_of(path);
  return container_of(extension) != nullptr ? extension : "";
}

absl::StatusOr<FilmFormat> film_format(const std::string& path, const std::string& codec, bool full_chroma,
                                       int bits) {
  FilmFormat film{.extension = film_extension(path), .full_chroma = full_chroma};
  const std::string word = codec.empty() ? container_of(film.extension)->usual : codec;
  film.codec = std::ranges::find(kCodecs, word, [](const FilmCodec& row) { return std::string(row.word); });
  if (film.codec == std::end(kCodecs)) {
    return unknown_word("--codec word", word, film_codecs());
  }
  if (std::ranges::count(film.codec->extensions, film.extension) == 0) {
    return usage_error(absl::StrFormat("--codec %s: %s cannot hold it; write %s", word, path,
                                       one_of(film.codec->extensions)));
  }
  if (bits == 8 && film.codec->deep) {
    return usage_error(absl::StrFormat("--bits 8: %s has 10 bits; leave it out", word));
  }
  film.bits = film.codec->deep || bits == 10 ? 10 : 8;
  return film;
}

PipeFormat piped_for(const FilmFormat& film, PipeFormat asked) {
  if (film.codec->deep) asked.kind = PipeKind::kY4m444;
  asked.bits = film.bits;
  if (!asked.matrix) asked.matrix = kRec709Luma;  // film_command() names it
  return asked;
}

std::vector<std::string> film_command(const FilmFormat& film, EncodedTransfer transfer, const HdrDisplay& hdr,
                                      const std::string& output) {
  const FilmContainer& container = *container_of(film.extension);
  const bool is_hevc = film.codec->word == std::string("hevc");
  std::vector<std::string> words = {"ffmpeg", "-hide_banner", "-loglevel",    "error", "-xerror",
                                    "-y",     "-f",           "yuv4mpegpipe", "-i",    "-"};
  // Options of the output would not do: ffmpeg takes an encoder's tags from its frames.
  words.insert(
      words.end(),
      {"-vf", absl::StrFormat("setparams=range=tv:color_primaries=%s:color_trc=%s:colorspace=%s",
                              primaries_of(transfer, hdr), trc_of(transfer), matrix_of(transfer, hdr))});
  words.insert(words.end(), film.codec->options.begin(), film.codec->options.end());
  if (is_hevc) words.insert(words.end(), {"-x265-params", x265_params(transfer, hdr)});
  if (film.codec->deep) words.insert(words.end(), {"-profile:v", film.full_chroma ? "4444" : "hq"});
  if (container.is_quicktime && is_hevc) words.insert(words.end(), {"-tag:v", "hvc1"});
  words.insert(words.end(), {"-pix_fmt", pixels_of(film)});
  if (container.is_quicktime) words.insert(words.end(), {"-movflags", "+faststart"});
  words.insert(words.end(), {"-f", container.muxer, output});
  return words;
}

namespace {

constexpr int kOutputDescriptor = 3;  // of FilmFile::kOutput
constexpr size_t kMostSaid = 4096;    // bytes
constexpr size_t kLastWords = 3;      // lines

// For a signal's handler.
std::atomic<pid_t> running_encoder{0};
static_assert(std::atomic<pid_t>::is_always_lock_free);

void close_end(int& descriptor) {
  if (descriptor >= 0) close(std::exchange(descriptor, -1));
}

// A pipe that no other program gets.
struct Ends {
  Ends() { opened = pipe2(ends.data(), O_CLOEXEC) == 0; }
  ~Ends() {
    close_end(ends[0]);
    close_end(ends[1]);
  }
  Ends(const Ends&) = delete;
  int take(int end) { return std::exchange(ends[end], -1); }

  std::array<int, 2> ends{-1, -1};  // read, write
  bool opened;
};

// Starts the program with these descriptors as 0, 2 and 3, and no others but a lost standard output. It has
// no part in the terminal's signals: this process decides when it ends. Returns 0 or an errno.
int start_program(const std::vector<std::string>& command, int input, int error, int output, pid_t& pid) {
  std::vector<char*> words;  // the function only reads them
  for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawnattr_t attributes;
  posix_spawn_file_actions_init(&files);
  posix_spawnattr_init(&attributes);
  const absl::Cleanup destroy = [&] {
    posix_spawn_file_actions_destroy(&files);
    posix_spawnattr_destroy(&attributes);
  };
  // The sources are above 2, as main() opens 0 .. 2, so none is replaced before it is used.
  posix_spawn_file_actions_adddup2(&files, input, STDIN_FILENO);
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_adddup2(&files, error, STDERR_FILENO);
  posix_spawn_file_actions_adddup2(&files, output, kOutputDescriptor);
  posix_spawn_file_actions_addclosefrom_np(&files, kOutputDescriptor + 1);
  sigset_t none, usual;
  sigemptyset(&none);
  sigemptyset(&usual);
  sigaddset(&usual, SIGPIPE);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &usual);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes,
                           POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  return posix_spawnp(&pid, "ffmpeg", &files, &attributes, words.data(), environ);
}

absl::Status cannot_start(const std::string& path, int error) {
  if (error != ENOENT) {
    return failure_of(FailureKind::kOther,
                      absl::ErrnoToStatus(error, absl::StrFormat("%s: cannot start ffmpeg", path)));
  }
  return failure_of(FailureKind::kOther,
                    absl::NotFoundError(absl::StrFormat(
                        "%s: ffmpeg makes films, and it is not installed; apt-get install ffmpeg, or write "
                        "images, such as out/%%04d.png",
                        path)));
}

}  // namespace

absl::StatusOr<std::unique_ptr<FilmFile>> FilmFile::open(const std::string& path,
                                                         const std::vector<std::string>& command) {
  ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(path));
  Ends frames, words;
  if (!frames.opened || !words.opened) return cannot_start(path, errno);
  std::signal(SIGCHLD, SIG_DFL);  // if it were ignored, nobody would learn how ffmpeg ended
  pid_t pid = 0;
  const int error = start_program(command, frames.ends[0], words.ends[1], file.descriptor(), pid);
  if (error != 0) return cannot_start(path, error);
  running_encoder = pid;
  fcntl(frames.ends[1], F_SETFL, O_NONBLOCK);
  return std::unique_ptr<FilmFile>(new FilmFile(std::move(file), pid, frames.take(1), words.take(0)));
}

FilmFile::~FilmFile() {
  if (encoder_ != 0) {
    kill(encoder_, SIGKILL);
    (void)wait_for_encoder();
  }
}

void FilmFile::end_encoder() {
  if (const pid_t pid = running_encoder; pid != 0) kill(pid, SIGKILL);
}

bool FilmFile::takes_frames() {
  pollfd ends[] = {{frames_, POLLOUT, 0}, {words_, POLLIN, 0}};
  if (poll(ends, 2, -1) < 0) return false;
  if (ends[1].revents != 0) {
    std::array<char, 1024> bytes{};
    const ssize_t count = ::read(words_, bytes.data(), bytes.size());
    if (count > 0) said_.append(bytes.data(), static_cast<size_t>(count));
    if (said_.size() > kMostSaid) said_.erase(0, said_.size() - kMostSaid);
    if (count == 0 || (count < 0 && errno != EINTR)) close_end(words_);
  }
  return ends[0].revents != 0;
}

absl::Status FilmFile::write(const void* bytes, size_t count) {
  const char* at = static_cast<const char*>(bytes);
  while (count > 0) {
    if (!takes_frames()) continue;
    const ssize_t written = ::write(frames_, at, count);
    if (written < 0 && errno != EAGAIN && errno != EINTR) {
      RETURN_IF_ERROR(wait_for_encoder());
      return failure(0);
    }
    if (written <= 0) continue;
    at += written;
    count -= static_cast<size_t>(written);
  }
  return absl::OkStatus();
}

absl::Status FilmFile::finish() {
  RETURN_IF_ERROR(wait_for_encoder());
  struct stat film {};
  if (fstat(file_.descriptor(), &film) == 0 && film.st_size == 0) return failure(0);
  return file_.commit();
}

absl::Status FilmFile::wait_for_encoder() {
  close_end(frames_);
  while (words_ >= 0) (void)takes_frames();
  // It stays a zombie until the handler cannot mean another process by its number.
  siginfo_t about{};
  while (waitid(P_PID, static_cast<id_t>(encoder_), &about, WEXITED | WNOWAIT) != 0 && errno == EINTR) {
  }
  running_encoder = 0;
  int ended = 0;
  while (waitpid(encoder_, &ended, 0) < 0 && errno == EINTR) {
  }
  encoder_ = 0;
  return ended == 0 ? absl::OkStatus() : failure(ended);
}

// One line: how it ended, and its last words.
absl::Status FilmFile::failure(int ended) const {
  const std::string how = WIFSIGNALED(ended) ? absl::StrFormat("a signal (%d) ended ffmpeg", WTERMSIG(ended))
                          : WEXITSTATUS(ended) != 0
                              ? absl::StrFormat("ffmpeg failed (%d)", WEXITSTATUS(ended))
                              : "ffmpeg ended before it made the film";
  const std::string said = absl::StrReplaceAll(said_, {{kOutput, path()}});
  std::vector<std::string> lines = absl::StrSplit(said, absl::ByAnyChar("\r\n"), absl::SkipWhitespace());
  if (lines.size() > kLastWords) lines.erase(lines.begin(), lines.end() - kLastWords);
  return failure_of(FailureKind::kOutput, absl::UnavailableError(absl::StrFormat(
                                              "%s: cannot write: %s%s%s", path(), how,
                                              lines.empty() ? "" : ": ", absl::StrJoin(lines, "; "))));
}

}  // namespace candela
