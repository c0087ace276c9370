// Opens an OpenEXR file and checks it; finds its layers and channels; reads its rows.
#pragma once

#include <ImathBox.h>
#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfThreading.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "client/image/image.h"
#include "client/image/read/file_reader.h"

namespace candela {

// The layers of an OpenEXR part, and the channels of a layer that make a picture.

// The channels of a part that share a prefix: R, G, B, or beauty.R, beauty.G, beauty.B. Colours without a dot
// in their names, such as LeR, LeG, LeB, are a layer, too.
struct ExrLayer {
  std::string view{};                   // "" if the part names none
  std::string name{};                   // the prefix without the view and the last dot; "" for plain names
  std::string prefix{};                 // such as "beauty.left."
  std::vector<std::string> channels{};  // full names
};

// The default view's layers first, and in each view the one with plain names first.
std::vector<ExrLayer> layers_of(const Imf::Header& header);

struct ExrChannels {
  enum class Kind {
    kRgb,         // red, green, blue; a channel that the file lacks reads as 0
    kGrey,        // `red` names the grey channel
    kLumaChroma,  // the prefix' Y, RY and BY
  };
  Kind kind = Kind::kRgb;
  std::string prefix{};
  std::string red{}, green{}, blue{};
  std::string alpha{};  // "" if there is none
  bool xyz = false;     // red, green and blue are CIE X, Y and Z

  bool operator==(const ExrChannels& other) const = default;
};

// R G B or red green blue, Y RY BY, or Y; alpha is A or alpha. RY and BY are capitals, all others in any
// case; of several spellings the first of these counts, and capitals before small letters. Returns nullopt if
// the layer has no colour.
std::optional<ExrChannels> colour_of(const ExrLayer& layer);

// What to show of a layer without colour: a vector X Y Z, or any other three channels in the file's order, as
// colour; or the only channel besides alpha as grey.
std::optional<ExrChannels> data_of(const ExrLayer& layer);

// Whether the layer has X, Y and Z.
bool has_xyz(const ExrLayer& layer);

// A name as messages show it: printable(), and whole for every channel and layer.
std::string shown_name(const std::string& name);

// Whether a user who typed `choice` means `name`: as it is in the file, or as messages show it.
bool is_called(const std::string& name, const std::string& choice);

// A list such as "R, G, B, Z" of at most twelve names, each as shown_name().
std::string name_list(const std::vector<std::string>& names);

// The limits of an OpenEXR picture, which its header is checked against before memory is allocated.

// The scan lines in a chunk of this compression.
int64_t rows_of_chunk(Imf::Compression compression);

// The bytes that OpenEXR decodes at a time, for a header that check_exr_picture() accepts.
uint64_t chunk_bytes(const Imf::Header& header);

// The format that these channels are read to: halves only if all of them are.
ImageFormat exr_format(const Imf::Header& header, const ExrChannels& channels);

// RESOURCE_EXHAUSTED if the windows or chunks exceed the limits, INVALID_ARGUMENT for an empty window,
// UNIMPLEMENTED for channels that are subsampled in an unusual way. Errors name `path`.
absl::Status check_exr_picture(const std::string& path, const Imf::Header& header,
                               const ExrChannels& channels, const ImageLimits& limits);

// OpenEXR's two windows. The display window is the picture. The data window is the area that the file stores,
// which may be smaller or larger.

// A rectangle in pixels, both ends included. 64 bits, so that no header causes an overflow.
struct Window {
  int64_t x0, y0, x1, y1;

  explicit Window(const Imath::Box2i& box) : x0(box.min.x), y0(box.min.y), x1(box.max.x), y1(box.max.y) {}
  int64_t width() const { return x1 - x0 + 1; }
  int64_t height() const { return y1 - y0 + 1; }
};

// The address that pixel (0, 0) of the file's coordinates would have if (x, y) is at `first`.
char* origin_of(std::byte* first, size_t pixel_bytes, size_t row_bytes, int64_t x, int64_t y);

// Where OpenEXR writes the channels of a picture that is not luminance-chroma. A channel that the file lacks
// reads as 0, and alpha as 1.
Imf::FrameBuffer frame_of(const ExrChannels& channels, ImageFormat format, char* origin, size_t row_bytes);

// Copies red to green and blue.
void spread_grey(ImageFormat format, std::byte* row, int64_t pixels);

// Reads rows y0 to y1 of the data window. `origin` is the address that pixel (0, 0) of the file's coordinates
// would have. Throws like OpenEXR.
using ReadRows = std::function<void(char* origin, size_t row_bytes, int64_t y0, int64_t y1)>;

// Reads a part that is not luminance-chroma. A channel that the file lacks reads as 0, and alpha as 1.
// `input` and `channels` must outlive what this returns. `threads` are for exr_zip.h; for what OpenEXR
// decodes they are those that the file was opened with.
ReadRows rows_of(Imf::InputPart& input, const ExrChannels& channels, ImageFormat format, int threads);

// Fills the part of `image` that `data` covers; `image` shows `display`. If rows of the data window fit into
// rows of the image, it reads them into place, otherwise through a band of rows. `grey` copies red to green
// and blue.
void read_windows(const Window& data, const Window& display, bool grey, const ReadRows& read_rows,
                  Image& image);

// Opens an OpenEXR file.

// The words in the error about a file that ends before a chunk that it should have.
inline constexpr char kFileEnds[] = "the file ends too early";

// Checks the header, opens the file from its beginning and calls `use`. Returns what `use` returns. OpenEXR's
// exceptions become statuses of one line that name the file: RESOURCE_EXHAUSTED if memory ran out, else
// INVALID_ARGUMENT.
// `threads` decode chunks side by side; 0 decodes them on this thread, one at a time.
absl::Status with_exr_file(FileReader& opened,
                           absl::FunctionRef<absl::Status(Imf::MultiPartInputFile& file)> use,
                           int threads = Imf::globalThreadCount());

// A stream of the file for another of OpenEXR's readers, which may read while none other does.
std::unique_ptr<Imf::IStream> stream_of(FileReader& opened);

}  // namespace candela
