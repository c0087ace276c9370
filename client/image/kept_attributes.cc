#include "client/image/kept_attributes.h"

#include <OpenEXR/ImfEnvmapAttribute.h>
#include <OpenEXR/ImfFloatAttribute.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <algorithm>
#include <iterator>

#include "absl/strings/string_view.h"

namespace candela {
namespace {

// https://openexr.com/en/latest/StandardAttributes.html; later versions have more than the one that Candela
// is built with.
constexpr absl::string_view kKept[] = {"altitude",
                                       "aperture",
                                       "ascFramingDecisionList",
                                       "cameraCCTSetting",
                                       "cameraColorBalance",
                                       "cameraFirmwareVersion",
                                       "cameraIdentifier",
                                       "cameraLabel",
                                       "cameraMake",
                                       "cameraModel",
                                       "cameraSerialNumber",
                                       "cameraTintSetting",
                                       "cameraUuid",
                                       "capDate",
                                       "captureRate",
                                       "comments",
                                       "effectiveFocalLength",
                                       "entrancePupilOffset",
                                       "envmap",
                                       "expTime",
                                       "focus",
                                       "imageCounter",
                                       "isoSpeed",
                                       "keyCode",
                                       "latitude",
                                       "lensFirmwareVersion",
                                       "lensMake",
                                       "lensModel",
                                       "lensSerialNumber",
                                       "longitude",
                                       "nominalFocalLength",
                                       "owner",
                                       "pinholeFocalLength",
                                       "reelName",
                                       "screenWindowCenter",
                                       "screenWindowWidth",
                                       "sensorAcquisitionRectangle",
                                       "sensorCenterOffset",
                                       "sensorOverallDimensions",
                                       "sensorPhotositePitch",
                                       "shutterAngle",
                                       "tStop",
                                       "timeCode",
                                       "utcOffset",
                                       "view",
                                       "worldToCamera",
                                       "worldToNDC",
                                       "wrapmodes",
                                       "xDensity"};

// Types of a few bytes; texts are checked by their length.
constexpr absl::string_view kSmallTypes[] = {"box2f",   "box2i", "double", "envmap",   "float",  "int",
                                             "keycode", "m44d",  "m44f",   "rational", "string", "timecode",
                                             "v2d",     "v2f",   "v2i",    "v3d",      "v3f",    "v3i"};

constexpr size_t kMostText = 1 << 20;

template <typename Names>
bool is_one(const Names& names, absl::string_view name) {
  return std::find(std::begin(names), std::end(names), name) != std::end(names);
}

bool is_kept(absl::string_view name, const Imf::Attribute& attribute) {
  if (!is_one(kKept, name) || !is_one(kSmallTypes, attribute.typeName())) return false;
  const auto* text = dynamic_cast<const Imf::StringAttribute*>(&attribute);
  return text == nullptr || text->value().size() <= kMostText;
}

int64_t size(const Imath::Box2i& window, unsigned axis) {
  return int64_t{window.max[axis]} - window.min[axis] + 1;
}

// Attributes of pixels that a resized picture no longer has: canvases in pixels, and the faces of a cube map,
// which were filtered as one picture.
bool counts_pixels(absl::string_view name, const Imf::Attribute& attribute) {
  const auto* envmap = dynamic_cast<const Imf::EnvmapAttribute*>(&attribute);
  return name == "ascFramingDecisionList" || (envmap != nullptr && envmap->value() == Imf::ENVMAP_CUBE);
}

}  // namespace

KeptAttributes::KeptAttributes(const Imf::Header& input) : window_(input.displayWindow()) {
  for (auto i = input.begin(); i != input.end(); ++i) {
    if (is_kept(i.name(), i.attribute())) attributes_.emplace_back(i.name(), i.attribute().copy());
  }
}

void KeptAttributes::add_to(Imf::Header& output) const {
  const Imath::Box2i& display = output.displayWindow();
  const bool resized = size(display, 0) != size(window_, 0) || size(display, 1) != size(window_, 1);
  for (const auto& [name, attribute] : attributes_) {
    if (!resized || !counts_pixels(name, *attribute)) output.insert(name, *attribute);
  }
  if (resized) {
    // Pixels per inch: the picture is as wide as before.
    if (auto* density = output.findTypedAttribute<Imf::FloatAttribute>("xDensity")) {
      density->value() *= static_cast<float>(size(display, 0)) / static_cast<float>(size(window_, 0));
    }
    return;
  }
  for (Imath::Box2i* window : {&output.displayWindow(), &output.dataWindow()}) {
    window->max += window_.min - window->min;
    window->min = window_.min;
  }
}

}  // namespace candela
