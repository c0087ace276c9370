// Reads OpenEXR files.
//
// Choices: the display window is the picture, and its pixels outside the data window are 0 with alpha 0. Of
// several levels the largest is used. Unsigned integers are plain values. Deep images are refused.
// exr_choice.h chooses the part and its channels. Luminance-chroma parts go through OpenEXR's own RGBA
// interface, which has the chroma filters and weighs Y by the part's chromaticities.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/algorithm/container.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/image/read/exr_checks.h"
#include "client/image/read/exr_choice.h"
#include "client/image/read/exr_color.h"
#include "client/image/read/exr_file.h"
#include "client/image/read/exr_luma_chroma.h"
#include "client/image/read/exr_windows.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

ReadRows rgb_rows(Imf::InputPart& input, const ExrChannels& channels, const Image& image) {
  return [&](char* origin, size_t row_bytes, int64_t y0, int64_t y1) {
    const Imf::PixelType type = image.format == ImageFormat::kRgba16f ? Imf::HALF : Imf::FLOAT;
    const size_t pixel_bytes = bytes_per_pixel(image.format);
    const size_t component_bytes = pixel_bytes / 4;
    Imf::FrameBuffer frame;
    const std::string* const names[] = {&channels.red, &channels.green, &channels.blue, &channels.alpha};
    for (size_t c = 0; c < 4; ++c) {
      // OpenEXR fills a slice if the file lacks its channel, so this must be a name that no file uses.
      const std::string name = names[c]->empty() ? absl::StrCat("\x01", c) : *names[c];
      const double fill = c == 3 ? 1.0 : 0.0;
      frame.insert(name, Imf::Slice(type, origin + c * component_bytes, pixel_bytes, row_bytes, 1, 1, fill));
    }
    input.setFrameBuffer(frame);
    input.readPixels(static_cast<int>(y0), static_cast<int>(y1));
  };
}

void read_attributes(const Imf::Header& header, Image& image) {
  set_pixel_aspect(header.pixelAspectRatio(), image);
  if (Imf::hasFramesPerSecond(header)) {
    const Imf::Rational& rate = Imf::framesPerSecond(header);
    if (rate.n > 0 && rate.d > 0) image.frame_rate = FrameRate{static_cast<uint64_t>(rate.n), rate.d};
  }
}

bool covers(const Window& data, const Window& display) {
  return data.x0 <= display.x0 && data.y0 <= display.y0 && data.x1 >= display.x1 && data.y1 >= display.y1;
}

absl::StatusOr<Image> read_open_file(const std::string& path, Imf::MultiPartInputFile& file,
                                     const ImageLimits& limits, const PictureChoice& choice) {
  absl::StatusOr<ExrPicture> picture = choose_exr_picture(path, file, choice);
  if (!picture.ok()) return picture.status();
  const ExrChannels& channels = picture->channels;
  const Imf::Header& header = file.header(picture->part);
  const Window data(header.dataWindow()), display(header.displayWindow());
  if (absl::Status status = check_exr_picture(path, header, channels, limits); !status.ok()) return status;

  const absl::StatusOr<ExrColor> color = exr_color(path, header, choice);
  if (!color.ok()) return color.status();
  const bool floats = choice.as_floats || color->curve != ColorCurve::kLinear;
  if (floats) {
    absl::Status status =
        check_image_size(path, "image", display.width(), display.height(), ImageFormat::kRgba32f, limits);
    if (!status.ok()) return status;
  }

  absl::StatusOr<Image> image =
      make_image(static_cast<uint32_t>(display.width()), static_cast<uint32_t>(display.height()),
                 exr_format(header, channels));
  if (!image.ok()) return image;
  image->has_alpha = !channels.alpha.empty() || !covers(data, display);
  read_attributes(header, *image);
  absl::c_move(picture->notes, std::back_inserter(image->notes));

  if (channels.kind == ExrChannels::Kind::kLumaChroma) {
    LumaChromaRows rows(path, file, picture->part, channels.prefix, limits.max_bytes);
    read_windows(data, display, false, rows.reader(), *image);
  } else {
    Imf::InputPart input(file, picture->part);
    const bool grey = channels.kind == ExrChannels::Kind::kGrey;
    read_windows(data, display, grey, rgb_rows(input, channels, *image), *image);
  }
  if (floats) image = to_floats(*std::move(image));
  if (image.ok()) apply(*color, *image);
  return image;
}

}  // namespace

absl::StatusOr<Image> read_exr(FileReader& opened, const ImageLimits& limits, const PictureChoice& choice) {
  absl::StatusOr<Image> image;
  const absl::Status status = with_exr_file(opened, [&](Imf::MultiPartInputFile& file) {
    image = read_open_file(opened.path(), file, limits, choice);
    return image.status();
  });
  if (!status.ok()) return status;
  return image;
}

}  // namespace candela
