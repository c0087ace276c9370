// Reads a luminance-chroma part of an OpenEXR file, with the chroma filters of OpenEXR's RGBA interface.
#pragma once

#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfRgbaFile.h>

#include <cstdint>
#include <memory>
#include <string>

#include "client/image/read/exr/exr_windows.h"
#include "client/image/read/file_reader.h"

namespace candela {

// OpenEXR's RGBA interface reads only a file's first part. A later one is copied, still compressed, into a
// file in memory. Used by one thread. Throws like OpenEXR.
class LumaChromaRows {
 public:
  // `prefix` is that of the channels' names, with its dot. The copy takes at most `max_bytes`.
  LumaChromaRows(FileReader& opened, Imf::MultiPartInputFile& file, int part, const std::string& prefix,
                 uint64_t max_bytes);
  ~LumaChromaRows();

  // Reads halves. This object must outlive it.
  ReadRows reader();

 private:
  class Copy;
  std::unique_ptr<Copy> copy_;            // null for the first part
  std::unique_ptr<Imf::IStream> stream_;  // of the file, if its first part is read
  std::unique_ptr<Imf::RgbaInputFile> input_;
};

}  // namespace candela
