// Reads OpenEXR files.
//
// Choices: the display window is the picture, and its pixels outside the data window are 0 with alpha 0. Of
// several levels the largest is used. Unsigned integers are plain values. Deep images are refused.
// exr_choice.h chooses the part and its channels. Luminance-chroma parts go through OpenEXR's own RGBA
// interface, which has the chroma filters and weighs Y by the part's chromaticities. If a picture cannot be
// read as a whole, it is read again in chunks, to say or to show what there is.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <cstdint>
#include <iterator>
#include <memory>
#include <utility>

#include "absl/algorithm/container.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/image/kept_attributes.h"
#include "client/image/primaries.h"
#include "client/image/read/exr/exr_checks.h"
#include "client/image/read/exr/exr_choice.h"
#include "client/image/read/exr/exr_color.h"
#include "client/image/read/exr/exr_file.h"
#include "client/image/read/exr/exr_gaps.h"
#include "client/image/read/exr/exr_luma_chroma.h"
#include "client/image/read/exr/exr_rate.h"
#include "client/image/read/exr/exr_windows.h"
#include "client/image/read/readers.h"
#include "client/image/read/signal.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr uint64_t kMostSideBySide = 32u << 20;  // bytes of a chunk of which several are decoded at once

void read_attributes(const Imf::Header& header, Image& image) {
  image.is_cube_map = Imf::hasEnvmap(header) && Imf::envmap(header) == Imf::ENVMAP_CUBE;
  set_pixel_aspect(header.pixelAspectRatio(), image);
  image.frame_rate = frame_rate_of(header);
}

bool covers(const Window& data, const Window& display) {
  return data.x0 <= display.x0 && data.y0 <= display.y0 && data.x1 >= display.x1 && data.y1 >= display.y1;
}

// Reads a picture of an open file. OpenEXR's exceptions are thrown on.
class PictureReader {
 public:
  PictureReader(FileReader& opened, const ImageLimits& limits, const PictureChoice& choice)
      : opened_(opened), path_(opened.path()), limits_(limits), choice_(choice) {}

  absl::StatusOr<Image> read(Imf::MultiPartInputFile& file) {
    absl::StatusOr<Image> image = begin(file);
    if (!image.ok()) return image;
    const Imf::Header& header = file.header(picture_.part);
    const int threads = chunk_bytes(header) > kMostSideBySide ? 0 : Imf::globalThreadCount();
    wants_one_thread_ = !wants_one_thread_ && threads < Imf::globalThreadCount();
    if (wants_one_thread_) return absl::CancelledError();
    at_pixels_ = true;
    const Window data(header.dataWindow()), display(header.displayWindow());
    if (is_luma_chroma()) {
      LumaChromaRows rows(opened_, file, picture_.part, picture_.channels.prefix, limits_.max_bytes);
      read_windows(data, display, false, rows.reader(), *image);
    } else {
      Imf::InputPart input(file, picture_.part);
      const bool grey = picture_.channels.kind == ExrChannels::Kind::kGrey;
      read_windows(data, display, grey, rows_of(input, picture_.channels, image->format, threads), *image);
    }
    return with_colour(*std::move(image));
  }

  // Whether the last read() did nothing, because several of the file's chunks at once would take too much
  // memory. Call it again for a file that is opened for one thread.
  bool wants_one_thread() const { return wants_one_thread_; }

  // Whether the last read() failed at the pixels, and not before.
  bool at_pixels() const { return at_pixels_; }

  // Reads what there is after read() failed at the pixels with `failure`. `file` is opened anew.
  absl::StatusOr<Image> read_incomplete(Imf::MultiPartInputFile& file, const absl::Status& failure) {
    const bool fills = choice_.fills_gaps && !is_luma_chroma();
    absl::StatusOr<Image> image = fills ? begin(file) : Image();
    if (!image.ok()) return image;
    ExrChannels channels = picture_.channels;
    if (is_luma_chroma()) channels = {.kind = ExrChannels::Kind::kGrey, .red = channels.prefix + "Y"};
    const Gaps gaps = read_with_gaps(file, picture_.part, channels, fills ? &*image : nullptr);
    if (gaps.missing == 0) {  // what is damaged is outside the picture
      if (fills) return with_colour(*std::move(image));
      return failure;
    }
    const std::string missing = absl::StrFormat("%d of its %d pixels are missing", gaps.missing, gaps.pixels);
    const std::string what =
        gaps.unfinished || absl::StrContains(failure.message(), kFileEnds)
            ? "the file is unfinished or cut off: " + missing
            : absl::StrCat(absl::StripPrefix(failure.message(), path_ + ": "), "; ", missing);
    if (gaps.missing == gaps.pixels || !fills) {
      const char* way_out = gaps.missing == gaps.pixels ? "render or copy it again"
                            : is_luma_chroma() ? "--incomplete fill does not read luminance and chroma"
                                               : "--incomplete fill renders what is there";
      return absl::InvalidArgumentError(absl::StrFormat("%s: %s; %s", path_, what, way_out));
    }
    image->notes.push_back(what + " and absent, with alpha 0");
    image->missing_pixels = gaps.missing;
    image->has_alpha = true;
    return with_colour(*std::move(image));
  }

 private:
  bool is_luma_chroma() const { return picture_.channels.kind == ExrChannels::Kind::kLumaChroma; }

  // Chooses the picture, checks the limits, and makes an image without its pixels.
  absl::StatusOr<Image> begin(const Imf::MultiPartInputFile& file) {
    ASSIGN_OR_RETURN(picture_, choose_exr_picture(path_, file, choice_));
    const ExrChannels& channels = picture_.channels;
    const Imf::Header& header = file.header(picture_.part);
    RETURN_IF_ERROR(check_exr_picture(path_, header, channels, limits_));
    const Window data(header.dataWindow()), display(header.displayWindow());
    ASSIGN_OR_RETURN(color_, exr_color(path_, header, choice_));
    if (channels.xyz && !choice_.own_values) color_.xy = kXyz.xy;
    if (wants_floats()) {
      absl::Status status =
          check_image_size(path_, "image", display.width(), display.height(), ImageFormat::kRgba32f, limits_);
      if (!status.ok()) return status;
    }
    const bool covered = covers(data, display);
    absl::StatusOr<Image> image = (covered && !choice_.fills_gaps ? image_to_overwrite : make_image)(
        static_cast<uint32_t>(display.width()), static_cast<uint32_t>(display.height()),
        exr_format(header, channels));
    if (!image.ok()) return image;
    image->has_alpha = !channels.alpha.empty() || !covered;
    read_attributes(header, *image);
    image->kept = std::make_shared<const KeptAttributes>(header);
    absl::c_move(picture_.notes, std::back_inserter(image->notes));
    return image;
  }

  bool wants_floats() const {
    return choice_.as_floats || color_.curve != ColorCurve::kLinear || decodes_values(choice_);
  }

  // The image that was read, with the colours that the file names.
  absl::StatusOr<Image> with_colour(Image read) const {
    absl::StatusOr<Image> image = wants_floats() ? to_floats(std::move(read)) : std::move(read);
    if (image.ok()) apply(color_, *image);
    return image;
  }

  FileReader& opened_;
  const std::string& path_;
  const ImageLimits& limits_;
  const PictureChoice& choice_;
  ExrPicture picture_;
  ExrColor color_;
  bool wants_one_thread_ = false;
  bool at_pixels_ = false;
};

}  // namespace

absl::StatusOr<Image> read_exr(FileReader& opened, const ImageLimits& limits, const PictureChoice& choice) {
  PictureReader reader(opened, limits, choice);
  absl::StatusOr<Image> image;
  const auto read = [&](Imf::MultiPartInputFile& file) {
    image = reader.read(file);
    return image.status();
  };
  absl::Status status = with_exr_file(opened, read);
  if (reader.wants_one_thread()) status = with_exr_file(opened, read, 0);
  if (absl::IsInvalidArgument(status) && reader.at_pixels()) {
    const absl::Status failure = status;
    const auto read_incomplete = [&](Imf::MultiPartInputFile& file) {
      image = reader.read_incomplete(file, failure);
      return image.status();
    };
    status = with_exr_file(opened, read_incomplete, 0);
  }
  if (!status.ok()) return status;
  return image;
}

}  // namespace candela
