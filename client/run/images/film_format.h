// The films that ffmpeg makes: which codecs there are, which files hold them, and ffmpeg's command line.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/image/write/piped_frames.h"
#include "server/encode/picture.h"

namespace candela {

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

}  // namespace candela
