// Writes OpenEXR: one ZIP-compressed scan-line part of half (kRgba16f) or float (kRgba32f), with alpha if the
// image has it. It says its primaries twice: by chromaticities and by a colorInteropID of linear light, such
// as lin_rec709_scene. A picture that a curve made for a display has the same ID, because every reader takes
// it as the linear light that it is, and Candela refuses a display's. Values of an unknown encoding say that
// it is unknown.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <cstdint>
#include <exception>
#include <stdexcept>

#include "absl/strings/str_format.h"
#include "client/image/color.h"
#include "client/image/kept_attributes.h"
#include "client/image/read/exr_file.h"
#include "client/image/write/writers.h"

namespace candela {
namespace {

constexpr char kInteropId[] = "colorInteropID";

// OpenEXR's stream interface for an AtomicFile.
class Stream : public Imf::OStream {
 public:
  explicit Stream(AtomicFile& file) : Imf::OStream(file.path().c_str()), file_(file) {}
  void write(const char* bytes, int count) override { check(file_.write(bytes, static_cast<size_t>(count))); }
  uint64_t tellp() override { return file_.position(); }
  void seekp(uint64_t position) override { check(file_.seek(position)); }

 private:
  static void check(bool done) {
    if (!done) throw std::runtime_error("write failed");
  }
  AtomicFile& file_;
};

Imf::Chromaticities chromaticities_of(const Image& image) {
  if (!image.chromaticities) return {};  // Rec.709, D65
  const std::array<float, 8>& c = *image.chromaticities;
  return {{c[0], c[1]}, {c[2], c[3]}, {c[4], c[5]}, {c[6], c[7]}};
}

}  // namespace

absl::Status write_exr(AtomicFile& file, const Image& image, const WriteOptions& options, Notes&) {
  try {
    const Imf::PixelType type = image.format == ImageFormat::kRgba16f ? Imf::HALF : Imf::FLOAT;
    const size_t pixel_bytes = bytes_per_pixel(image.format);
    Imf::Header header(static_cast<int>(image.width), static_cast<int>(image.height),
                       static_cast<float>(image.pixel_aspect));
    header.compression() = Imf::ZIP_COMPRESSION;
    if (options.transfer == EncodedTransfer::kUnknown) {
      header.insert(kInteropId, Imf::StringAttribute("unknown"));
    } else {
      Imf::addChromaticities(header, chromaticities_of(image));
      header.insert(kInteropId, Imf::StringAttribute(linear_interop_id(image.chromaticities)));
    }
    if (const auto& rate = image.frame_rate;
        rate && rate->frames <= INT32_MAX && rate->seconds <= UINT32_MAX) {
      Imf::addFramesPerSecond(
          header, Imf::Rational(static_cast<int>(rate->frames), static_cast<unsigned>(rate->seconds)));
    }
    if (image.kept != nullptr) image.kept->add_to(header);
    const Imath::V2i& origin = header.dataWindow().min;
    Imf::FrameBuffer frame;
    const char* const names[] = {"R", "G", "B", "A"};
    for (size_t c = 0; c < (image.has_alpha ? 4 : 3); ++c) {
      header.channels().insert(names[c], Imf::Channel(type));
      // The library uses the same type for reading, so the pointer is not const.
      std::byte* first = const_cast<std::byte*>(image.pixels.data()) + c * pixel_bytes / 4;
      char* base = origin_of(first, pixel_bytes, image.row_bytes(), origin.x, origin.y);
      frame.insert(names[c], Imf::Slice(type, base, pixel_bytes, image.row_bytes()));
    }
    Stream stream(file);
    Imf::OutputFile output(stream, header);
    output.setFrameBuffer(frame);
    output.writePixels(static_cast<int>(image.height));
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrFormat("cannot encode the OpenEXR file: %s", error.what()));
  }
  return absl::OkStatus();
}

}  // namespace candela
