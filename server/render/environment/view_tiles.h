// What a view needs beside its settings: the scene for the shaders, its tiles, and views on the host.
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "server/base/crew.h"
#include "server/render/environment/environment.h"
#include "server/render/environment/view.h"
#include "server/render/frame/frame_memory.h"
#include "server/render/plan/lit_area.h"
#include "server/vulkan/pipeline.h"
#include "shaders/environment/environment_params.h"

namespace candela {

// Which parts of a view are drawn how: work groups of view.comp, or parts of rows on the host. Internal to
// server/render. Pure.

// What a work group does. The sky's come first.
struct ViewKind {
  bool objects = false;
  bool magnified = false;  // these and the next two are the shader's constants
  bool sharp = false;
  bool rough = false;
  uint32_t first_object = 0;
  uint32_t end_object = 0;

  auto operator<=>(const ViewKind&) const = default;
};
// `floats`: the view is drawn as floats.
Constants constants_of(const ViewKind& kind, const View& view, bool floats);

// Work groups x0 to x1 - 1 of a row.
struct ViewRun {
  ViewKind kind;
  uint32_t x0 = 0;
  uint32_t x1 = 0;
};

// The directions in which a sphere is seen, in camera axes.
struct SphereCone {
  Vector3 axis;         // of length 1
  double sine, cosine;  // of the angle between the axis and the edge, which is less than 90 degrees
};

// The rows of tiles of a view, which is not kept. `objects` are those of the view; they outlive this.
class ViewTiles {
 public:
  ViewTiles(const View& view, const shader::ViewParams& params, std::span<const shader::ViewObject> objects);

  uint32_t rows() const;
  // The runs of row y: first those of the sky, which cover it, and then the objects', over the tiles that one
  // may touch. Any thread.
  std::vector<ViewRun> row(uint32_t y) const;

 private:
  ViewKind kind_of_tile(uint32_t x, uint32_t y) const;

  const shader::ViewParams params_;
  const std::span<const shader::ViewObject> objects_;
  const std::vector<SphereCone> cones_;
};

// The runs of consecutive rows as boxes. `first` is the number of the first row.
std::map<ViewKind, std::vector<Box>> boxes_of(std::span<const std::vector<ViewRun>> rows, uint32_t first);

// About what a row costs, in pixels of a magnified sky.
double cost_of(const std::vector<ViewRun>& row, const View& view);
// If each tile of the row showed each object.
double most_cost_of_row(const View& view, uint32_t width);

// A view in the form that view.comp reads. Internal to server/render. Pure.

// Without objects and first_row.
shader::ViewParams view_params(const View& view, uint32_t width, uint32_t height, uint32_t pitch,
                               uint32_t chain_size);

// `specular` has the levels after level 0, with the perceptual mapping; it may be empty. `brdf` is the BRDF
// table: halves, row by row.
std::vector<shader::ViewObject> view_objects(const View& view, const CubeLevels& specular,
                                             std::span<const uint16_t> brdf);
shader::ViewLight view_light(const Harmonics& irradiance);
// What the shader reads as the scene.
std::vector<std::byte> view_scene(const shader::ViewLight& light,
                                  std::span<const shader::ViewObject> objects);

// Views that the host draws. Internal to server/render and its tests.

// Draws a view into the input of a frame of floats or of halves. `cube` has what the view reads, mapped. The
// bits do not depend on the threads.
void draw_on_host(const BakedCube& cube, bool floats, const View& view, const shader::ViewLight& light,
                  std::span<const shader::ViewObject> objects, FrameMemory& memory, Crew& crew);

}  // namespace candela
