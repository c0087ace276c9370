#include "client/color/view_table.h"

#include <OpenColorIO/OpenColorIO.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <optional>
#include <random>
#include <span>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/color/view_config.h"
#include "server/base/status_macros.h"
#include "server/render/color/primaries.h"
#include "shaders/reference.h"

namespace candela {
namespace {

namespace ocio = OCIO_NAMESPACE;

constexpr uint32_t kTableSize = 65;
constexpr char kVariable[] = "$OCIO";  // ViewChoice::source
// If 99.9 % of the colours are within this error, no other kind of table is tried. In codes.
constexpr double kGoodCodes = 0.75;
// On AP1's axes light changes further up, because a film-like view desaturates it only there.
constexpr float kLeastEndAp1 = 320.0f;

std::string list(int count, const std::function<const char*(int)>& name) {
  std::vector<std::string> names;
  for (int i = 0; i < count; ++i) names.push_back(name(i));
  return names.empty() ? "none" : absl::StrJoin(names, ", ");
}

// Fills in the defaults of display and view. NOT_FOUND if the configuration does not have them.
absl::Status choose_view(const ocio::ConstConfigRcPtr& config, const ViewChoice& choice, ViewTable& chosen) {
  chosen.display = choice.display.empty() ? config->getDefaultDisplay() : choice.display;
  const char* display = chosen.display.c_str();
  const int displays = config->getNumDisplays();
  const auto display_name = [&](int i) { return config->getDisplay(i); };
  bool known = false;
  for (int i = 0; i < displays; ++i) known = known || chosen.display == display_name(i);
  if (!known) {
    return absl::NotFoundError(absl::StrFormat("%s has no display \"%s\"; there are: %s", choice.config,
                                               display, list(displays, display_name)));
  }
  chosen.view = choice.view.empty() ? config->getDefaultView(display) : choice.view;
  const int views = config->getNumViews(display);
  const auto view_name = [&](int i) { return config->getView(display, i); };
  known = false;
  for (int i = 0; i < views; ++i) known = known || chosen.view == view_name(i);
  if (known) return absl::OkStatus();
  return absl::NotFoundError(absl::StrFormat("%s has no view \"%s\" for display \"%s\"; there are: %s",
                                             choice.config, chosen.view, display, list(views, view_name)));
}

void show(const ocio::ConstCPUProcessorRcPtr& view, std::span<float> rgb) {
  ocio::PackedImageDesc image(rgb.data(), static_cast<long>(rgb.size() / 3), 1, 3);
  view->apply(image);
}

// The difference of two values as they are shown, in codes. NaN counts as black.
double codes_apart(double a, double b) {
  const auto shown = [](double v) { return v > 0.0 ? std::min(v, 1.0) : 0.0; };
  return 255.0 * std::abs(shown(a) - shown(b));
}

// Pseudo-random in [low, high), the same on every machine.
class Random {
 public:
  double operator()(double low, double high) { return low + (high - low) * (random_() / 4294967296.0); }

 private:
  std::mt19937 random_{1};
};

// The lowest end of the axes such that cutting light there changes 99 % of the values by at most half a code.
float axis_end(const ocio::ConstCPUProcessorRcPtr& view, uint32_t axes) {
  constexpr float kEnds[] = {1.0f, 2.0f, 8.0f, 32.0f, 128.0f, 512.0f, 2048.0f, 8192.0f};
  constexpr size_t kColors = 1000;
  for (const float end : kEnds) {
    Random random;
    std::vector<float> rgb;
    std::vector<float> cut;
    for (size_t i = 0; i < 3 * kColors; ++i) rgb.push_back(static_cast<float>(std::exp2(random(-2.0, 16.0))));
    for (size_t i = 0; i < rgb.size(); i += 3) {
      for (const float v : light_within_axes({rgb[i], rgb[i + 1], rgb[i + 2]}, axes, end)) cut.push_back(v);
    }
    show(view, rgb);
    show(view, cut);
    size_t changed = 0;
    for (size_t i = 0; i < rgb.size(); ++i) changed += codes_apart(rgb[i], cut[i]) > 0.5;
    if (changed * 100 <= rgb.size()) return axes == shader::AXES_AP1 ? std::max(end, kLeastEndAp1) : end;
  }
  return 65504.0f;
}

// Display light for a value, by the sRGB curve. `mirrored` says how the curve continues below 0.
double to_light(double value, bool mirrored) {
  const double v = mirrored ? std::abs(value) : value;
  const double light = v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
  return mirrored ? std::copysign(light, value) : light;
}

// Appends saturated colours up to the gamuts of ACES AP1, Rec.2020 and P3, as Rec.709 light: mixtures of two
// of the primaries, or of all three with one far below the others.
void add_wide_colors(Random& random, std::vector<float>& rgb) {
  constexpr int kColors = 3000;
  for (const v1::Primaries primaries :
       {v1::PRIMARIES_ACES_AP1, v1::PRIMARIES_REC2020, v1::PRIMARIES_P3_D65}) {
    const auto to_rec709 = matrix_to_rec709(chromaticities(primaries));
    for (int i = 0; i < kColors; ++i) {
      const double light = std::exp2(random(-12.0, 8.0));
      std::array<double, 3> color;
      for (double& v : color) v = light * random(0.0, 1.0);
      color[static_cast<size_t>(random(0.0, 3.0))] = i % 2 == 0 ? 0.0 : light * std::exp2(random(-10.0, 0.0));
      for (size_t r = 0; r < 3; ++r) {
        double v = 0.0;
        for (size_t c = 0; c < 3; ++c) v += (**to_rec709)[3 * r + c] * color[c];
        rgb.push_back(static_cast<float>(v));
      }
    }
  }
}

void measure(const ocio::ConstCPUProcessorRcPtr& view, ViewTable& baked) {
  constexpr int kGreys = 2000;
  constexpr int kColors = 10000;
  Random random;
  std::vector<float> rgb;
  for (int i = 0; i < kGreys; ++i)
    rgb.insert(rgb.end(), 3, static_cast<float>(std::exp2(random(-12.0, 8.0))));
  for (int i = 0; i < kColors; ++i) {
    const double light = random(-11.0, 7.0);
    for (int k = 0; k < 3; ++k) rgb.push_back(static_cast<float>(std::exp2(light + random(-1.0, 1.0))));
    for (int k = 0; k < 3; ++k) rgb.push_back(static_cast<float>(std::exp2(random(-12.0, 8.0))));
  }
  add_wide_colors(random, rgb);
  const std::vector<float> scene = rgb;
  show(view, rgb);
  std::vector<double> codes;
  double sum = 0.0;
  for (size_t i = 0; i < rgb.size(); i += 3) {
    const reference::Rgb light = reference::look_up(baked.table, {scene[i], scene[i + 1], scene[i + 2]});
    for (size_t k = 0; k < 3; ++k) {
      const double value = reference::transfer(shader::TRANSFER_SRGB, std::clamp(light[k], 0.0, 1.0));
      codes.push_back(codes_apart(value, rgb[i + k]));
      sum += codes.back();
    }
  }
  std::sort(codes.begin(), codes.end());
  baked.max_codes = codes.back();
  baked.p999_codes = codes[codes.size() * 999 / 1000];
  baked.mean_codes = sum / static_cast<double>(codes.size());
}

// A processor of the transforms without approximations of logarithms and powers.
ocio::ConstCPUProcessorRcPtr processor(const ocio::ConstConfigRcPtr& config,
                                       std::initializer_list<ocio::TransformRcPtr> transforms) {
  const ocio::GroupTransformRcPtr group = ocio::GroupTransform::Create();
  for (const ocio::TransformRcPtr& transform : transforms) group->appendTransform(transform);
  return config->getProcessor(group)->getOptimizedCPUProcessor(ocio::OPTIMIZATION_LOSSLESS);
}

ocio::TransformRcPtr view_of(const ViewTable& chosen, const std::string& input) {
  const ocio::DisplayViewTransformRcPtr transform = ocio::DisplayViewTransform::Create();
  transform->setSrc(input.c_str());
  transform->setDisplay(chosen.display.c_str());
  transform->setView(chosen.view.c_str());
  return transform;
}

// The file's values to scene light; null if they are it.
std::function<void(std::span<float>)> scene_of(const ocio::ConstConfigRcPtr& config, const std::string& input,
                                               const ViewEntry& entry) {
  const ocio::ColorSpaceTransformRcPtr enter = ocio::ColorSpaceTransform::Create();
  enter->setSrc(input.c_str());
  enter->setDst(entry.space.c_str());
  const ocio::TransformRcPtr to_rec709 = entry.from_rec709->createEditableCopy();
  to_rec709->setDirection(ocio::TRANSFORM_DIR_INVERSE);
  const ocio::ConstCPUProcessorRcPtr scene = processor(config, {enter, to_rec709});
  if (scene->isNoOp()) return nullptr;
  return [scene](std::span<float> rgb) { show(scene, rgb); };
}

// Whether OpenColorIO lets values pass, because the view or the input is data.
bool shows_data(const ocio::ConstConfigRcPtr& config, const ViewTable& chosen, const std::string& input) {
  const auto is_data = [&](const std::string& name) {
    const ocio::ConstColorSpaceRcPtr space = config->getColorSpace(name.c_str());
    return space && space->isData();
  };
  const std::string shown = config->getDisplayViewColorSpaceName(chosen.display.c_str(), chosen.view.c_str());
  return is_data(shown == ocio::OCIO_VIEW_USE_DISPLAY_NAME ? chosen.display : shown) || is_data(input);
}

// Whether the view shows light below 0 as something else than 0, which a table cannot hold.
bool shows_below_0(const ocio::ConstCPUProcessorRcPtr& view) {
  std::vector<float> rgb = {0.0f, 0.0f, 0.0f, -0.01f, -0.01f, -0.01f, -0.1f, -0.1f, -0.1f};
  show(view, rgb);
  for (size_t i = 3; i < rgb.size(); ++i) {
    if (codes_apart(rgb[i], rgb[i % 3]) > 0.5) return true;
  }
  return false;
}

absl::StatusOr<ViewTable> bake(const ViewChoice& choice) {
  ASSIGN_OR_RETURN(const ocio::ConstConfigRcPtr config, load_config(choice));
  ViewTable baked;
  RETURN_IF_ERROR(choose_view(config, choice, baked));
  absl::StatusOr<ViewEntry> entry = find_entry(config, choice);
  baked.as_is = shows_data(config, baked, choice.input);
  if (!entry.ok() && !(baked.as_is && choice.input.empty())) return entry.status();
  if (baked.as_is) {
    baked.input = choice.input;
    baked.show = [](std::span<float>) {};
    return baked;
  }
  baked.input = !choice.lut_input.empty() ? choice.lut_input
                : choice.input.empty()    ? entry->space
                                          : choice.input;
  baked.notes = std::move(entry->notes);
  const ocio::ConstCPUProcessorRcPtr view =
      processor(config, {entry->from_rec709, view_of(baked, entry->space)});
  baked.show = [view](std::span<float> rgb) { show(view, rgb); };
  // Of a camera's log, light below 0 is the noise of black.
  if (choice.lut_input == lut_inputs().front() && shows_below_0(view)) {
    baked.notes.push_back("the LUT's domain begins below 0, and light below 0 is cut to 0 before it");
  }
  if (!choice.input.empty()) {
    const ocio::ConstCPUProcessorRcPtr input = processor(config, {view_of(baked, choice.input)});
    baked.show_input = [input](std::span<float> rgb) { show(input, rgb); };
    baked.to_scene = scene_of(config, choice.input, *entry);
  }

  // Chooses the kind of table that fits the view best.
  std::optional<ViewTable> best;
  for (const uint32_t axes : {shader::AXES_ACES, shader::AXES_AP1, shader::AXES_REC709}) {
    const float end = axis_end(view, axes);
    std::vector<float> values = lattice_light(kTableSize, axes, end);
    show(view, values);
    for (const bool mirrored : {false, true}) {
      std::vector<float> light(values.size());
      std::transform(values.begin(), values.end(), light.begin(),
                     [mirrored](float v) { return static_cast<float>(to_light(v, mirrored)); });
      baked.table = make_color_table(kTableSize, axes, end, light);
      measure(view, baked);
      if (!best || baked.p999_codes < best->p999_codes) best = baked;
      if (best->p999_codes <= kGoodCodes) return *std::move(best);
    }
  }
  return *std::move(best);
}

}  // namespace

absl::StatusOr<ViewTable> bake_view(const ViewChoice& choice) {
  const auto named = [&choice](const absl::Status& status) {
    if (choice.source != kVariable) return status;
    return absl::Status(status.code(),
                        absl::StrFormat("%s; %s names the configuration, and --curve does without it",
                                        status.message(), kVariable));
  };
  try {
    absl::StatusOr<ViewTable> baked = bake(choice);
    if (!baked.ok()) return named(baked.status());
    return baked;
  } catch (const std::exception& thrown) {
    return named(unusable(choice, thrown));
  }
}

}  // namespace candela
