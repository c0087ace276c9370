#include "client/image/read/exr/exr_luma_chroma.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfRgbaYca.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include "absl/strings/str_format.h"
#include "client/image/read/exr/exr_file.h"

namespace candela {
namespace {

// What decoding needs of a part's header.
Imf::Header header_of(const Imf::Header& part) {
  Imf::Header header(part.displayWindow(), part.dataWindow(), part.pixelAspectRatio(),
                     part.screenWindowCenter(), part.screenWindowWidth(), part.lineOrder(),
                     part.compression());
  header.channels() = part.channels();
  if (Imf::hasChromaticities(part)) Imf::addChromaticities(header, Imf::chromaticities(part));
  return header;
}

// Throws what RgbaInputFile's constructor would throw, which loses the open file then.
void check_weights(const Imf::Header& part) {
  if (Imf::hasChromaticities(part)) Imf::RgbaYca::computeYw(Imf::chromaticities(part));
}

}  // namespace

// A file in memory, written once and then read.
class LumaChromaRows::Copy {
 public:
  Copy(Imf::MultiPartInputFile& file, int part, uint64_t max_bytes)
      : to_(*this), from_(*this), max_(max_bytes) {
    Imf::InputPart input(file, part);
    Imf::OutputFile output(to_, header_of(input.header()), 0);
    output.copyPixels(input);
  }
  Imf::IStream& stream() { return from_; }

 private:
  struct To : Imf::OStream {
    explicit To(Copy& file) : Imf::OStream("a part in memory"), copy(file) {}
    void write(const char* bytes, int count) override { copy.write(bytes, static_cast<uint64_t>(count)); }
    uint64_t tellp() override { return at; }
    void seekp(uint64_t position) override { at = position; }
    Copy& copy;
    uint64_t at = 0;
  };
  struct From : Imf::IStream {
    explicit From(Copy& file) : Imf::IStream("a part in memory"), copy(file) {}
    bool read(char* bytes, int count) override { return copy.read(bytes, static_cast<uint64_t>(count)); }
    uint64_t tellg() override { return at; }
    void seekg(uint64_t position) override { at = position; }
    Copy& copy;
    uint64_t at = 0;
  };

  void write(const char* bytes, uint64_t count) {
    if (count > max_ || to_.at > max_ - count) {
      throw std::runtime_error(absl::StrFormat("its luminance-chroma part takes more than %d bytes", max_));
    }
    bytes_.resize(std::max<uint64_t>(bytes_.size(), to_.at + count));
    std::memcpy(bytes_.data() + to_.at, bytes, count);
    to_.at += count;
  }

  bool read(char* bytes, uint64_t count) {
    if (from_.at > bytes_.size() || count > bytes_.size() - from_.at)
      throw std::runtime_error("the part ends");
    std::memcpy(bytes, bytes_.data() + from_.at, count);
    from_.at += count;
    return from_.at < bytes_.size();
  }

  To to_;
  From from_;
  const uint64_t max_;
  std::string bytes_;
};

LumaChromaRows::LumaChromaRows(FileReader& opened, Imf::MultiPartInputFile& file, int part,
                               const std::string& prefix, uint64_t max_bytes) {
  check_weights(file.header(part));
  const std::string layer = prefix.substr(0, prefix.empty() ? 0 : prefix.size() - 1);
  if (part == 0) {
    stream_ = stream_of(opened);
    input_ = std::make_unique<Imf::RgbaInputFile>(*stream_, layer);
  } else {
    copy_ = std::make_unique<Copy>(file, part, max_bytes);
    input_ = std::make_unique<Imf::RgbaInputFile>(copy_->stream(), layer);
  }
}

LumaChromaRows::~LumaChromaRows() = default;

ReadRows LumaChromaRows::reader() {
  return [this](char* origin, size_t row_bytes, int64_t y0, int64_t y1) {
    input_->setFrameBuffer(reinterpret_cast<Imf::Rgba*>(origin), 1, row_bytes / sizeof(Imf::Rgba));
    input_->readPixels(static_cast<int>(y0), static_cast<int>(y1));
  };
}

}  // namespace candela
