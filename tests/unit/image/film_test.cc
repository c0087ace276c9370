// The command lines of films, and HDR films by the ffmpeg that is installed.
#include "client/run/film.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_join.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

constexpr char kRec2020Display[] =
    "hdr10=1:repeat-headers=1:master-display=G(8500,39850)B(6550,2300)R(35400,14600)WP(15635,16450)";
constexpr char kP3Display[] =
    "hdr10=1:repeat-headers=1:master-display=G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)";

FilmFormat film_of(const std::string& path, const std::string& codec, int bits = 10) {
  const auto film = film_format(path, codec, false, bits);
  EXPECT_OK(film);
  return *film;
}

std::string line_of(const FilmFormat& film, EncodedTransfer transfer, const HdrDisplay& hdr = {}) {
  return absl::StrJoin(film_command(film, transfer, hdr, "out"), " ");
}

TEST(FilmFormat, AnHdrFilmHasTheTagsOfItsSignal) {
  const FilmFormat film = film_of("a.mp4", "h264");
  EXPECT_TRUE(says(line_of(film, EncodedTransfer::kPq),
                   "setparams=range=tv:color_primaries=bt2020:color_trc=smpte2084:colorspace=bt2020nc "));
  EXPECT_TRUE(says(line_of(film, EncodedTransfer::kHlg),
                   "setparams=range=tv:color_primaries=bt2020:color_trc=arib-std-b67:colorspace=bt2020nc "));
  EXPECT_TRUE(says(line_of(film, EncodedTransfer::kPq, {.p3 = true}),
                   "setparams=range=tv:color_primaries=smpte432:color_trc=smpte2084:colorspace=bt709 "));
  EXPECT_TRUE(says(line_of(film, EncodedTransfer::kHlg, {.p3 = true}),
                   "setparams=range=tv:color_primaries=smpte432:color_trc=arib-std-b67:colorspace=bt709 "));
  EXPECT_TRUE(says(line_of(film, EncodedTransfer::kSrgb, {.p3 = true}),
                   "setparams=range=tv:color_primaries=bt709:color_trc=iec61966-2-1:colorspace=bt709 "));
}

TEST(FilmFormat, OnlyAnHevcInPqNamesItsDisplay) {
  const FilmFormat hevc = film_of("a.mp4", "hevc");
  EXPECT_TRUE(says(line_of(hevc, EncodedTransfer::kPq),
                   std::string(" -x265-params log-level=error:") + kRec2020Display + "L(10000000,1) "));
  EXPECT_TRUE(says(line_of(hevc, EncodedTransfer::kPq, {.p3 = true, .peak_nits = 1499.99999}),
                   std::string(" -x265-params log-level=error:") + kP3Display + "L(15000000,1) "));
  for (const auto transfer : {EncodedTransfer::kHlg, EncodedTransfer::kSrgb, EncodedTransfer::kUnknown}) {
    EXPECT_TRUE(says(line_of(hevc, transfer), " -x265-params log-level=error -tag:v"));
  }
  for (const auto& [path, codec] : {std::pair("a.mp4", "h264"), {"a.mkv", "av1"}, {"a.mov", "prores"}}) {
    EXPECT_FALSE(absl::StrContains(line_of(film_of(path, codec), EncodedTransfer::kPq), "x265"));
  }
}

TEST(FilmFormat, AFilmKeepsTheMatrixOfItsPictures) {
  // One of SDR is BT.709's at any size.
  for (const auto& [matrix, code] : {std::pair(std::optional<LumaMatrix>(), 1), {kRec2020Luma, 9}}) {
    const PipeFormat h264 = piped_for(film_of("a.mp4", "h264"), {PipeKind::kY4m420, 10, matrix});
    EXPECT_TRUE(h264.kind == PipeKind::kY4m420 && h264.bits == 10 && h264.matrix->code == code);
    const PipeFormat prores = piped_for(film_of("a.mov", "prores", 0), {PipeKind::kY4m420, 8, matrix});
    EXPECT_TRUE(prores.kind == PipeKind::kY4m444 && prores.bits == 10 && prores.matrix->code == code);
  }
}

// The output of a shell's command.
std::string output_of(const std::string& command) {
  std::FILE* pipe = popen(command.c_str(), "r");
  std::string output;
  char bytes[4096];
  for (size_t count = 0; (count = fread(bytes, 1, sizeof bytes, pipe)) > 0;) output.append(bytes, count);
  EXPECT_EQ(pclose(pipe), 0) << command;
  return output;
}

// Writes three frames of one colour as a film.
void make_film(const std::string& path, const FilmFormat& film, EncodedTransfer transfer,
               const HdrDisplay& hdr, const uint16_t (&rgb)[3]) {
  const PipeFormat asked = pipe_format(PipeKind::kY4m420, 0, transfer, hdr);
  const PipeFormat pipe = piped_for(film, asked);
  Image picture = *make_image(64, 48, ImageFormat::kRgba16);
  for (size_t i = 0; i < size_t{64} * 48; ++i) std::memcpy(picture.pixels.data() + 8 * i, rgb, sizeof rgb);
  std::vector<std::string> words = film_command(film, transfer, hdr, path);
  for (std::string& word : words) word = "'" + word + "'";
  std::FILE* ffmpeg = popen(absl::StrJoin(words, " ").c_str(), "w");
  ASSERT_NE(ffmpeg, nullptr);
  const std::string header = film_header(pipe, 64, 48, 1, {24, 1});
  fwrite(header.data(), 1, header.size(), ffmpeg);
  std::vector<std::byte> frame;
  make_piped_frame(pipe, picture, frame);
  for (int i = 0; i < 3; ++i) fwrite(frame.data(), 1, frame.size(), ffmpeg);
  EXPECT_EQ(pclose(ffmpeg), 0);
}

TEST(FilmFormat, FfmpegMakesHdrFilmsThatSayWhatTheyAre) {
  if (std::system("ffmpeg -version > /dev/null 2>&1") != 0) GTEST_SKIP() << "there is no ffmpeg";
  const TemporaryFolder folder;
  constexpr uint16_t kRed[] = {45000, 9000, 5000};
  for (const auto& [name, codec] : {std::pair("a.mp4", "hevc"),
                                    {"b.mkv", "hevc"},
                                    {"c.mp4", "h264"},
                                    {"d.webm", "av1"},
                                    {"e.mov", "prores"}}) {
    for (const bool p3 : {false, true}) {
      for (const auto transfer : {EncodedTransfer::kPq, EncodedTransfer::kHlg}) {
        SCOPED_TRACE(::testing::Message() << name << " " << codec << (p3 ? " P3" : " Rec.2020"));
        const HdrDisplay hdr{.p3 = p3, .peak_nits = 1200};
        const bool pq = transfer == EncodedTransfer::kPq;
        const std::string path = folder.path(name);
        make_film(path, film_of(name, codec), transfer, hdr, kRed);
        const std::string facts = output_of(
            "ffprobe -v error -of default=nw=1 -show_entries "
            "stream=codec_name,pix_fmt,color_range,color_space,color_transfer,color_primaries " +
            path);
        for (const std::string& fact :
             {std::string("codec_name=") + codec,
              std::string(codec == std::string("prores") ? "422p10" : "420p10"),
              std::string("color_range=tv"), std::string(p3 ? "color_space=bt709" : "color_space=bt2020nc"),
              std::string(pq ? "color_transfer=smpte2084" : "color_transfer=arib-std-b67"),
              std::string(p3 ? "color_primaries=smpte432" : "color_primaries=bt2020")}) {
          EXPECT_TRUE(says(facts, fact));
        }
        if (codec == std::string("hevc")) {
          const std::string side =
              output_of("ffprobe -v error -of default=nw=1 -read_intervals '%+#1' -show_frames " + path);
          EXPECT_EQ(absl::StrContains(side, p3 ? "red_x=34000/50000" : "red_x=35400/50000"), pq) << side;
          EXPECT_EQ(absl::StrContains(side, "max_luminance=12000000/10000"), pq) << side;
          EXPECT_EQ(absl::StrContains(side, "min_luminance=1/10000"), pq) << side;
        }
        // ffmpeg decodes by the matrix that the film names. A wrong one shifts a colour by tens of codes.
        const std::string pixels = output_of(
            "ffmpeg -v error -i " + path +
            " -vf scale=flags=accurate_rnd+full_chroma_int -frames:v 1 -pix_fmt rgb48le -f rawvideo -");
        ASSERT_EQ(pixels.size(), size_t{64} * 48 * 6);
        uint16_t middle[3];
        std::memcpy(middle, pixels.data() + 6 * (size_t{24} * 64 + 32), sizeof middle);
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(middle[c], kRed[c], 400) << c;
      }
    }
  }
}

}  // namespace
}  // namespace candela
