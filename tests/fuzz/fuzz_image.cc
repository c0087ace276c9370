// Reads any bytes as image files of every kind. The limits on pixels are small. So if a file exceeds the
// fuzzer's memory limit (run.sh), the reader took memory for pixels that the file does not have.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/image/describe.h"
#include "client/image/image.h"
#include "client/image/read/image_stream.h"
#include "tests/fuzz/expect.h"

namespace candela {
namespace {

// Large enough for the damaged files, small enough for some thousand a second.
constexpr ImageLimits kLimits{.max_dimension = 4096, .max_bytes = 8 << 20, .max_chunk_bytes = 8 << 20};

// A file in memory; FileReader and OpenEXR both open it by its path.
class MemoryFile {
 public:
  MemoryFile()
      : descriptor_(memfd_create("fuzz", MFD_CLOEXEC)), path_(absl::StrCat("/proc/self/fd/", descriptor_)) {
    expect(descriptor_ >= 0, "there is a file in memory");
  }
  void set(const uint8_t* data, size_t size) {
    expect(ftruncate(descriptor_, 0) == 0 && pwrite(descriptor_, data, size, 0) == static_cast<ssize_t>(size),
           "the file holds the input");
  }
  const std::string& path() const { return path_; }
  int descriptor() const {
    lseek(descriptor_, 0, SEEK_SET);
    return descriptor_;
  }

 private:
  const int descriptor_;
  const std::string path_;
};

// An error must be one line, whatever is in the file.
bool is_plain(absl::string_view text) {
  return std::ranges::all_of(text, [](unsigned char c) { return absl::ascii_isprint(c) || c >= 0x80; });
}

void check_image(const Image& image) {
  expect(image.format == ImageFormat::kRgba16f || image.format == ImageFormat::kRgba32f,
         "files are read to floats");
  expect(image.width >= 1 && image.width <= kLimits.max_dimension, "the width is within the limits");
  expect(image.height >= 1 && image.height <= kLimits.max_dimension, "the height is within the limits");
  expect(image.bytes() <= kLimits.max_bytes, "the pixels are within the limits");
  expect(image.pixels.size() == image.bytes(), "the pixels are all there");
  expect(image.pixel_aspect >= 0.01 && image.pixel_aspect <= 100, "the pixel aspect is a usable number");
  for (const std::string& note : image.notes) expect(is_plain(note), "a note is plain text", note);
  if (image.chromaticities) {
    for (const float v : *image.chromaticities) expect(std::isfinite(v), "chromaticities are numbers");
  }
}

void check_description(const FileFacts& facts) {
  for (const PartFacts& part : facts.parts) {
    expect(is_plain(part.name), "a part's name is plain text", part.name);
    for (const auto* names : {&part.views, &part.layers}) {
      for (const std::string& name : *names) expect(is_plain(name), "a view or layer is plain text", name);
    }
    for (const ChannelFacts& channel : part.channels) {
      expect(is_plain(channel.name), "a channel's name is plain text", channel.name);
    }
  }
  expect(is_plain(facts.shown), "what is shown is plain text", facts.shown);
  for (const std::string& note : facts.notes) expect(is_plain(note), "a note is plain text", note);
}

void check_error(const absl::Status& status, const std::string& path) {
  const absl::StatusCode code = status.code();
  expect(code == absl::StatusCode::kInvalidArgument || code == absl::StatusCode::kResourceExhausted ||
             code == absl::StatusCode::kUnimplemented,
         "the code is one of read_image's", status.ToString());
  expect(absl::StartsWith(status.message(), path + ": "), "the error names the file", status.ToString());
  expect(is_plain(status.message()), "the error is plain text", status.ToString());
}

// The same bytes, as if they came through a pipe.
void check_stream(int descriptor) {
  ImageStream stream(descriptor, "pipe", kLimits, {});
  while (const std::optional<absl::StatusOr<Image>> image = stream.next()) {
    if (image->ok()) {
      check_image(**image);
    } else {
      check_error(image->status(), stream.name());
    }
  }
}

}  // namespace
}  // namespace candela

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace candela;
  static MemoryFile file;
  file.set(data, size);
  const absl::StatusOr<Image> image = read_image(file.path(), kLimits);
  if (image.ok()) {
    check_image(*image);
  } else {
    check_error(image.status(), file.path());
  }
  const absl::StatusOr<Image> filled = read_image(file.path(), kLimits, {.fills_gaps = true});
  expect(filled.ok() || !image.ok(), "what can be read can be read in parts");
  if (filled.ok()) {
    check_image(*filled);
    expect(!image.ok() || filled->missing_pixels == 0, "a whole file lacks nothing");
  } else {
    check_error(filled.status(), file.path());
  }
  check_stream(file.descriptor());
  const absl::StatusOr<FileFacts> facts = describe_image(file.path(), kLimits);
  if (facts.ok()) {
    check_description(*facts);
    if (!facts->renderable.ok()) check_error(facts->renderable, file.path());
    expect(!image.ok() || facts->renderable.ok(), "what can be read is described as such");
    // Every part can be chosen, or says why not.
    for (size_t part = 2; part <= std::min<size_t>(facts->parts.size(), 4); ++part) {
      const absl::StatusOr<Image> chosen = read_image(file.path(), kLimits, {.part = std::to_string(part)});
      if (chosen.ok()) {
        check_image(*chosen);
      } else {
        check_error(chosen.status(), file.path());
      }
    }
  } else {
    check_error(facts.status(), file.path());
    expect(!image.ok(), "what can be read can be described");
  }
  return 0;
}
