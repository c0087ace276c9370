#include "client/image/read/exr/exr_file.h"

#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfVersion.h>
#include <OpenEXR/OpenEXRConfig.h>

#include <cstdint>
#include <exception>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "client/base/failure.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMaxLibraryText = 1000;  // characters of an OpenEXR error that are passed on

// OpenEXR's stream interface for a FileReader. OpenEXR's own stream reads nothing more once it has met the
// file's end, so a chunk beyond it would hide those before.
class FileStream : public Imf::IStream {
 public:
  explicit FileStream(FileReader& file) : Imf::IStream(file.path().c_str()), file_(file) {}
  bool read(char* bytes, int count) override {
    const auto wanted = static_cast<uint64_t>(count);
    if (at_ > file_.size() || wanted > file_.size() - at_ || (file_.position() != at_ && !file_.seek(at_)) ||
        !file_.read(std::as_writable_bytes(std::span(bytes, wanted)))) {
      throw std::runtime_error(kFileEnds);
    }
    at_ += wanted;
    return at_ < file_.size();
  }
  uint64_t tellg() override { return at_; }
  void seekg(uint64_t position) override { at_ = position; }

 private:
  FileReader& file_;
  uint64_t at_ = 0;
};

constexpr uint32_t kMultiPart = 1u << 12;  // in the version field

bool read_u32(FileReader& file, uint32_t& value) {
  value = 0;
  for (int shift = 0; shift < 32; shift += 8) {
    const int byte = file.get();
    if (byte < 0) return false;
    value |= static_cast<uint32_t>(byte) << shift;
  }
  return true;
}

// Takes a name up to its zero byte. False if it is longer than the 255 letters that a name may have.
bool read_name(FileReader& file, std::string& name) {
  name.clear();
  for (int byte = file.get(); byte != 0; byte = file.get()) {
    if (byte < 0 || name.size() == 255) return false;
    name.push_back(static_cast<char>(byte));
  }
  return true;
}

// The sizes in bytes of types that OpenEXR knows. It reads that many bytes, whatever the file claims.
constexpr std::pair<absl::string_view, uint32_t> kFixedSizes[] = {
    {"box2f", 16},
    {"box2i", 16},
    {"chromaticities", 32},
    {"compression", 1},
    {"deepImageState", 1},
    {"double", 8},
    {"envmap", 1},
    {"float", 4},
    {"int", 4},
    {"keycode", 28},
    {"lineOrder", 1},
    {"m33d", 72},
    {"m33f", 36},
    {"m44d", 128},
    {"m44f", 64},
    {"rational", 8},
    {"tiledesc", 9},
    {"timecode", 8},
    {"v2d", 16},
    {"v2f", 8},
    {"v2i", 8},
    {"v3d", 24},
    {"v3f", 12},
    {"v3i", 12},
};

// Takes the value of an attribute. False if the value does not have the size that it claims. Then OpenEXR
// would continue reading at the wrong place or allocate memory of another size.
bool take_value(FileReader& file, const std::string& type, uint32_t size) {
  const uint64_t end = file.remaining() - size;
  for (const auto& [fixed, bytes] : kFixedSizes) {
    if (type == fixed && size != bytes) return false;
  }
  std::string name;
  uint32_t width = 0, height = 0, length = 0;
  if (type == "chlist") {
    constexpr uint32_t kChannelBytes = 16;
    do {
      if (!read_name(file, name) || (!name.empty() && !file.skip(kChannelBytes))) return false;
    } while (!name.empty());
    return file.remaining() == end;
  }
  if (type == "preview") {
    return size >= 8 && read_u32(file, width) && read_u32(file, height) && width <= size && height <= size &&
           uint64_t{size} == 8 + uint64_t{4} * width * height && file.skip(size - 8);
  }
  if (type == "stringvector") {
    while (file.remaining() > end) {
      if (!read_u32(file, length) || !file.skip(length)) return false;
    }
    return file.remaining() == end;
  }
  return file.skip(size);
}

// UNIMPLEMENTED for a version of the format, or a kind of file, that this OpenEXR does not know.
absl::Status check_version(const std::string& path, uint32_t version) {
  const bool known = static_cast<int>(version & Imf::VERSION_NUMBER_FIELD) <= Imf::EXR_VERSION &&
                     Imf::supportsFlags(static_cast<int>(version & Imf::VERSION_FLAGS_FIELD));
  if (known) return absl::OkStatus();
  return absl::UnimplementedError(absl::StrFormat(
      "%s: version %d of OpenEXR's format, with flags %#x, is newer than OpenEXR %s, which this "
      "candela has; save it with an older program",
      path, version & Imf::VERSION_NUMBER_FIELD, version & Imf::VERSION_FLAGS_FIELD, OPENEXR_VERSION_STRING));
}

// Looks at the value of the attribute `compression`. UNIMPLEMENTED if this OpenEXR does not know it.
absl::Status check_compression(FileReader& file) {
  ASSIGN_OR_RETURN(const std::string byte, file.peek(1));
  const int number = byte.empty() ? 0 : static_cast<unsigned char>(byte.front());
  if (number < Imf::NUM_COMPRESSION_METHODS) return absl::OkStatus();
  // https://openexr.com/en/latest/OpenEXRFileLayout.html, "compression"
  const std::string what = number == 10   ? "HTJ2K256, which OpenEXR 3.4 and later read"
                           : number == 11 ? "HTJ2K32, which OpenEXR 3.4 and later read"
                                          : "which a later OpenEXR may read";
  return absl::UnimplementedError(absl::StrFormat(
      "%s: its compression is number %d, %s; this candela has OpenEXR %s, so save it with ZIP (such as "
      "oiiotool IN.exr --compression zip -o OUT.exr)",
      file.path(), number, what, OPENEXR_VERSION_STRING));
}

// OpenEXR 3.1 allocates as much memory for an attribute as the file claims, which may be gigabytes for a file
// of 200 bytes. This function walks over the attributes of every part (see "file layout" in the Technical
// Introduction to OpenEXR). It returns INVALID_ARGUMENT if an attribute is larger than the rest of the file
// or the header does not end, and UNIMPLEMENTED if this OpenEXR does not know the version of the format or a
// part's compression. It leaves checking the other values to OpenEXR.
absl::Status check_exr_header(FileReader& file) {
  uint32_t magic = 0, version = 0, size = 0;
  std::string name, type;
  bool whole = read_u32(file, magic) && read_u32(file, version);
  if (absl::Status known = check_version(file.path(), version); whole && !known.ok()) return known;
  const bool multi_part = (version & kMultiPart) != 0;
  int attributes = 0;
  while (whole) {
    whole = read_name(file, name);
    if (whole && name.empty()) {
      // The end of a part's header. In a multi-part file an empty header ends the list.
      if (!multi_part || attributes == 0) return absl::OkStatus();
      attributes = 0;
      continue;
    }
    ++attributes;
    whole = whole && read_name(file, type) && read_u32(file, size);
    if (whole && size > file.remaining()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: damaged OpenEXR file: attribute %s claims %d bytes, but only %d are left",
                          file.path(), printable(name), size, file.remaining()));
    }
    if (whole && type == "compression" && size == 1) {
      RETURN_IF_ERROR(check_compression(file));
    }
    if (whole && !take_value(file, type, size)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: damaged OpenEXR file: attribute %s does not have the %d bytes that it claims",
                          file.path(), printable(name), size));
    }
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: damaged OpenEXR file: the header is not a complete list of attributes", file.path()));
}

}  // namespace

std::unique_ptr<Imf::IStream> stream_of(FileReader& opened) { return std::make_unique<FileStream>(opened); }

absl::Status with_exr_file(FileReader& opened,
                           absl::FunctionRef<absl::Status(Imf::MultiPartInputFile& file)> use, int threads) {
  opened.seek(0);
  RETURN_IF_ERROR(check_exr_header(opened));
  const std::string& path = opened.path();
  try {
    FileStream stream(opened);
    Imf::MultiPartInputFile file(stream, threads);
    return use(file);
  } catch (const std::bad_alloc&) {
    return failure_of(
        FailureKind::kOther,
        absl::ResourceExhaustedError(absl::StrFormat(
            "%s: not enough memory to decode it; give this process more, or scale it down", path)));
  } catch (const std::exception& error) {
    // Removes the file's name, which the library adds and our message has already. The text may quote the
    // file's content.
    const std::string quoted = absl::StrCat(" \"", path, "\"");
    const std::string text =
        absl::StrReplaceAll(error.what(), {{absl::string_view(quoted), ""}, {"\n", " "}});
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: damaged OpenEXR file: %s", path, printable(text, kMaxLibraryText)));
  }
}

}  // namespace candela
