// OpenEXR files with several parts and layers.
#pragma once

#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>

#include <initializer_list>
#include <string>
#include <vector>

#include "absl/strings/str_format.h"
#include "tests/unit/image/exr/exr_reader_fixture.h"

namespace candela {

inline ExrChannel constant(const std::string& name, double value, Imf::PixelType type = Imf::HALF) {
  return {name, type, [value](int, int) { return value; }};
}

inline std::vector<ExrChannel> colour(const std::string& prefix, double value) {
  return {constant(prefix + "R", value), constant(prefix + "G", value + 1),
          constant(prefix + "B", value + 2)};
}

inline std::vector<ExrChannel> all(std::initializer_list<std::vector<ExrChannel>> lists) {
  std::vector<ExrChannel> channels;
  for (const auto& list : lists) channels.insert(channels.end(), list.begin(), list.end());
  return channels;
}

struct TestPart {
  std::string name, view;
  std::vector<ExrChannel> channels;
};

inline void write_parts(const std::string& path, const std::vector<TestPart>& parts) {
  std::vector<Imf::Header> headers;
  std::vector<ExrPixels> pixels;
  for (const TestPart& part : parts) {
    Imf::Header& header = headers.emplace_back(6, 4);
    header.setName(part.name);
    header.setType(Imf::SCANLINEIMAGE);
    if (!part.view.empty()) header.setView(part.view);
    pixels.emplace_back(header, part.channels);
  }
  Imf::MultiPartOutputFile file(path.c_str(), headers.data(), static_cast<int>(headers.size()));
  for (int i = 0; i < static_cast<int>(parts.size()); ++i) {
    Imf::OutputPart part(file, i);
    part.setFrameBuffer(pixels[i].frame());
    part.writePixels(4);
  }
}

// As colour(), with other names for the components.
inline std::vector<ExrChannel> named(const std::vector<std::string>& names, double value) {
  std::vector<ExrChannel> channels;
  for (const std::string& name : names) channels.push_back(constant(name, value++));
  return channels;
}

class ExrChoice : public ExrReader {
 protected:
  // The first pixel's red, green and blue, or the error.
  std::string pixel(const PictureChoice& choice) {
    const absl::StatusOr<Image> image = read_image(path_, {}, choice);
    if (!image.ok()) return std::string(image.status().message()).substr(path_.size() + 2);
    return absl::StrFormat("%g %g %g", component(*image, 0, 0, 0), component(*image, 0, 0, 1),
                           component(*image, 0, 0, 2));
  }
};

}  // namespace candela
