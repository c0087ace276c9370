#include "client/image/kept_attributes.h"

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

}  // namespace

KeptAttributes::KeptAttributes(const Imf::Header& input) : origin_(input.displayWindow().min) {
  for (auto i = input.begin(); i != input.end(); ++i) {
    if (is_kept(i.name(), i.attribute())) attributes_.emplace_back(i.name(), i.attribute().copy());
  }
}

void KeptAttributes::add_to(Imf::Header& output) const {
  for (const auto& [name, attribute] : attributes_) output.insert(name, *attribute);
  for (Imath::Box2i* window : {&output.displayWindow(), &output.dataWindow()}) {
    window->max += origin_ - window->min;
    window->min = origin_;
  }
}

}  // namespace candela
