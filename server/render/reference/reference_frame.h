// A frame in float64, stage by stage, and work on the rows of an image on every core.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "server/render/frame/frame_textures.h"
#include "server/render/plan/plan.h"
#include "shaders/reference.h"

namespace candela {

// Texels first <= x < last of row y.
struct RowSpan {
  uint32_t y;
  uint32_t first;
  uint32_t last;
};

// The number of parts to split the rows into: one for each usable core, at most one for each row.
uint32_t row_parts(uint32_t height);

// Runs work(span, part) for all texels of a width x height image. Each of `parts` parts of the rows is done
// by one thread at a time, row by row and from left to right; a span has at most some thousand texels. Goes
// through checkpoints between spans, on the calling thread and with no other thread at work. Where the system
// gives no thread, the calling thread does the part. Returns when all are done.
void for_row_parts(uint32_t width, uint32_t height, uint32_t parts,
                   const std::function<void(const RowSpan& span, uint32_t part)>& work);

// A frame as the float64 reference makes it: the scene, its metering and its bloom, ready to be resolved.

// The largest value of a component of an OUTPUT_* format; 0 for formats that do not quantise.
double largest_code(uint32_t format);

// Long work goes through checkpoints.
class ReferenceFrame {
 public:
  // `level_size` is TextureLayout::level_size: kWholeBloom, or a tier's own.
  ReferenceFrame(MeteredScene scene, const Plan& plan, uint32_t level_size);

  // Resolves from a scene whose colours with a negative component, or all if the plan says so, are not
  // rounded; metering and bloom stay.
  void unround(const FrameTextures& textures, const Plan& plan);

  const MeteredScene& metered() const { return metered_; }
  // The image's size.
  uint32_t width() const { return scene().width; }
  uint32_t height() const { return scene().height; }
  // The light that the bloom adds at an intensity of 1, at one texel of level 0; `bloom` may be empty.
  const reference::Level& bloom() const { return bloom_; }
  reference::Rgb bloom_light(uint32_t x, uint32_t y) const;

  // Whether colour is straight: not multiplied by alpha.
  bool straight() const { return resolve_.alpha == shader::ALPHA_STRAIGHT; }

  // The display values of these texels, before dither and quantising. Any thread.
  std::vector<std::array<double, 4>> row(const RowSpan& span) const;

  // Of the whole image: see reference::cut_components().
  uint64_t cut_components() const;
  // How bright the image is on an HDR display.
  ShownLight shown_light() const;

  // Component k (0 .. 2) of texel (x, y) in codes of an output that has codes 0 to `largest`, dithered but
  // not rounded; `value` is its display value.
  double code(double value, double largest, uint32_t x, uint32_t y, size_t k) const;

 private:
  void resize();
  const reference::Scene& scene() const { return resized_ ? *resized_ : metered_.scene; }

  MeteredScene metered_;
  reference::Level bloom_;
  uint32_t levels_ = 1;               // the number of levels that `bloom_` sums
  reference::ResolveParams light_;    // how bloom joins the scene
  reference::ResolveParams resolve_;  // how the image is made of scene()
  ImageSize image_;
  std::optional<reference::Scene> resized_;  // if the image has another size
  std::optional<uint32_t> dither_frame_;
};

// Makes the scene of the wire pixels and meters it.
MeteredScene meter_scene(const FrameTextures& textures, const std::optional<reference::Matrix>& matrix,
                         const reference::MeterParams& params, reference::Rounding rounding);

}  // namespace candela
