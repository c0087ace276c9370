#include "client/run/images/film_format.h"

#include <algorithm>
#include <filesystem>
#include <iterator>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/usage.h"
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

// ".mp4, .mov or .mkv".
std::string list_of(const std::vector<std::string>& words) {
  return absl::StrJoin(words.begin(), std::prev(words.end()), ", ") + " or " + words.back();
}

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
  return list_of(words);
}

std::string film_extension(const std::string& path) {
  std::string extension = absl::AsciiStrToLower(std::filesystem::path(path).extension().string());
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
                                       list_of(film.codec->extensions)));
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

}  // namespace candela
