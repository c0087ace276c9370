// What an OpenEXR output keeps of its input's header.
#pragma once

#include <OpenEXR/ImfAttribute.h>
#include <OpenEXR/ImfHeader.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace candela {

// The standard attributes that stay true when the picture's values change: who made it, when, where and with
// which camera and lens, its time code, its projection, and where its display window lies. Left out are
// colour, previews, everything about how pixels are stored, and texts of more than 1 MiB. Frames per second
// and pixel aspect have their own members in Image.
class KeptAttributes {
 public:
  explicit KeptAttributes(const Imf::Header& input);

  // `output` has the picture's display window at 0, 0. If it has the input's size, it moves with the data
  // window to where the input's is. Otherwise the picture was resized: attributes that count the input's
  // pixels are left out or scaled.
  void add_to(Imf::Header& output) const;

 private:
  std::vector<std::pair<std::string, std::unique_ptr<Imf::Attribute>>> attributes_;
  Imath::Box2i window_;  // the input's display window
};

}  // namespace candela
