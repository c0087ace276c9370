#include "client/color/view_entry.h"

#include <span>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

namespace ocio = OCIO_NAMESPACE;

// The names and aliases that configurations use for linear Rec.709.
constexpr const char* kRec709Names[] = {
    "lin_rec709_scene",           "lin_rec709_srgb", "lin_rec709",    "lin_srgb",
    "Linear Rec.709 (sRGB)",      "Linear Rec.709",  "Linear BT.709", "Utility - Linear - sRGB",
    "Utility - Linear - Rec.709", "Linear sRGB",     "lnf_srgb"};
constexpr const char* kAp0Names[] = {"lin_ap0_scene", "ACES2065-1", "ACES - ACES2065-1", "aces", "lin_ap0"};
constexpr const char* kAp1Names[] = {"lin_ap1_scene", "ACEScg", "ACES - ACEScg", "acescg", "lin_ap1"};

ViewEntry entry_of(const std::string& space) { return {ocio::GroupTransform::Create(), space, {}}; }

ViewEntry ap1_entry(const std::string& space) {
  ViewEntry entry = entry_of(space);
  append_builtin(entry.from_rec709, "UTILITY - ACES-AP1_to_LINEAR-REC709_BFD", ocio::TRANSFORM_DIR_INVERSE);
  return entry;
}

ViewEntry ap0_entry(const std::string& space) {
  ViewEntry entry = ap1_entry(space);
  append_builtin(entry.from_rec709, "ACEScg_to_ACES2065-1", ocio::TRANSFORM_DIR_FORWARD);
  return entry;
}

// The name of the first of the colour spaces that the configuration has, "" for none.
std::string first_space(const ocio::ConstConfigRcPtr& config, std::span<const char* const> names) {
  for (const char* name : names) {
    if (const ocio::ConstColorSpaceRcPtr space = config->getColorSpace(name)) return space->getName();
  }
  return "";
}

// The name of the colour space of a role. OpenColorIO loads a configuration whose role names none.
absl::StatusOr<std::string> space_of_role(const ocio::ConstConfigRcPtr& config, const ViewChoice& choice,
                                          const char* role) {
  const ocio::ConstColorSpaceRcPtr space = config->getColorSpace(role);
  if (space) return std::string(space->getName());
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: its role %s names a colour space that it does not have", choice.config, role));
}

std::string spaces_of(const ocio::ConstConfigRcPtr& config) {
  std::vector<std::string> names;
  for (int i = 0; i < config->getNumColorSpaces(); ++i)
    names.emplace_back(config->getColorSpaceNameByIndex(i));
  return names.empty() ? "none" : absl::StrJoin(names, ", ");
}

// For values in choice.input.
absl::StatusOr<ViewEntry> entry_for_input(const ocio::ConstConfigRcPtr& config, const ViewChoice& choice) {
  if (!config->getColorSpace(choice.input.c_str())) {
    return absl::NotFoundError(absl::StrFormat("%s has no colour space \"%s\"; there are: %s", choice.config,
                                               choice.input, spaces_of(config)));
  }
  const char* const interchange[] = {ocio::ROLE_INTERCHANGE_SCENE};
  const char* const linear[] = {ocio::ROLE_SCENE_LINEAR, choice.input.c_str()};
  if (const std::string space = first_space(config, interchange); !space.empty()) return ap0_entry(space);
  if (const std::string space = first_space(config, kRec709Names); !space.empty()) return entry_of(space);
  if (const std::string space = first_space(config, kAp0Names); !space.empty()) return ap0_entry(space);
  if (const std::string space = first_space(config, kAp1Names); !space.empty()) return ap1_entry(space);
  return entry_of(first_space(config, linear));
}

}  // namespace

void append_builtin(const ocio::GroupTransformRcPtr& group, const char* style,
                    ocio::TransformDirection direction) {
  const ocio::BuiltinTransformRcPtr builtin = ocio::BuiltinTransform::Create();
  builtin->setStyle(style);
  builtin->setDirection(direction);
  group->appendTransform(builtin);
}

absl::StatusOr<ViewEntry> find_entry(const ocio::ConstConfigRcPtr& config, const ViewChoice& choice) {
  if (!choice.input.empty()) return entry_for_input(config, choice);
  if (config->hasRole(ocio::ROLE_INTERCHANGE_SCENE)) {
    ASSIGN_OR_RETURN(const std::string space, space_of_role(config, choice, ocio::ROLE_INTERCHANGE_SCENE));
    return ap0_entry(space);
  }
  if (const std::string space = first_space(config, kRec709Names); !space.empty()) {
    ViewEntry entry = entry_of(space);
    entry.notes.push_back(absl::StrFormat(
        "the view gets the scene as \"%s\", taken to be linear Rec.709; --ocio-input names another", space));
    return entry;
  }
  if (config->hasRole(ocio::ROLE_SCENE_LINEAR)) {
    const absl::StatusOr<std::string> space = space_of_role(config, choice, ocio::ROLE_SCENE_LINEAR);
    if (!space.ok()) return space.status();
    ViewEntry entry = entry_of(*space);
    entry.notes.push_back(absl::StrFormat(
        "%s does not say what primaries its scene_linear, \"%s\", has: taken to be linear Rec.709; "
        "--ocio-input names another colour space",
        choice.config, *space));
    return entry;
  }
  return absl::NotFoundError(
      absl::StrFormat("%s has neither a role aces_interchange nor scene_linear; name its linear Rec.709 with "
                      "--ocio-input: %s",
                      choice.config, spaces_of(config)));
}

}  // namespace candela
