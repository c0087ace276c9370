#include "client/run/baked_view.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/describe.h"
#include "client/run/picture_frame.h"

namespace candela {

std::string view_words(const ViewReport& view) {
  return view.source == "--ocio" || view.source == "--lut" ? view.view
                                                           : absl::StrCat(view.view, " of ", view.source);
}

absl::StatusOr<BakedView> bake(const PictureOptions& options) {
  const ViewChoice& choice = options.view;
  absl::StatusOr<ViewTable> baked = bake_view(choice);
  if (!baked.ok()) {
    const bool is_image = describe_image(choice.config, default_image_limits()).ok();
    return input_failure(
        is_image ? absl::InvalidArgumentError(absl::StrFormat(
                       "%s: OpenColorIO cannot use it: it is an image; %s", choice.config,
                       choice.lut_input.empty() ? "--ocio takes a configuration, such as config.ocio"
                                                : "--lut takes a LUT, such as look.cube"))
                 : baked.status(),
        choice.config);
  }
  const ColorTable& table = baked->table;
  BakedView view;
  view.table.set_size(table.size);
  view.table.set_axes(static_cast<v1::ColorTable::Axes>(table.axes));
  view.table.set_end(table.end);
  view.table.set_values(table.values.data(), table.values.size() * sizeof table.values[0]);
  view.report = {baked->display,   baked->view,       baked->input,      table.size,    table.end,
                 baked->max_codes, baked->p999_codes, baked->mean_codes, choice.config, choice.source};
  view.notes = std::exchange(baked->notes, {});
  if (baked->as_is && has_primaries(options.settings)) {
    view.notes.push_back("--primaries changes nothing: the view shows the file's own values");
  }
  baked->table = {};
  view.view = *std::move(baked);
  return view;
}

void show_by(const BakedView& view, v1::Settings& settings) {
  if (!view.view.as_is) {
    *settings.mutable_table() = view.table;
    return;
  }
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.set_transfer(v1::TRANSFER_LINEAR);
  settings.clear_input_primaries();
  settings.clear_input_chromaticities();
}

PictureChoice choice_of(const PictureOptions& options, const BakedView* view) {
  PictureChoice choice = options.shown;
  choice.own_values =
      has_primaries(options.settings) || !options.view.input.empty() || (view != nullptr && view->view.as_is);
  if (has_primaries(options.settings)) choice.primaries = primaries_used({}, options.settings).xy;
  choice.keeps_signal = !options.view.input.empty() || (view != nullptr && view->view.as_is);
  choice.as_floats = view != nullptr && view->view.to_scene;
  return choice;
}

void enter_scene(const BakedView* view, Image& image) {
  if (view == nullptr || !view->view.to_scene) return;
  std::vector<float> rgb(size_t{3} * image.width);
  for (uint32_t y = 0; y < image.height; ++y) {
    std::byte* const row = image.pixels.data() + y * image.row_bytes();
    const auto each = [&](auto change) {
      for (size_t x = 0; x < image.width; ++x) {
        std::array<float, 4> pixel;
        std::memcpy(pixel.data(), row + x * sizeof pixel, sizeof pixel);
        const float alpha = pixel[3] > 0 && std::isfinite(pixel[3]) ? pixel[3] : 1.0f;
        for (size_t c = 0; c < 3; ++c) change(pixel[c], rgb[3 * x + c], alpha);
        std::memcpy(row + x * sizeof pixel, pixel.data(), sizeof pixel);
      }
    };
    each([](float component, float& value, float alpha) { value = component / alpha; });
    view->view.to_scene(rgb);
    each([](float& component, float value, float alpha) { component = value * alpha; });
  }
}

}  // namespace candela
