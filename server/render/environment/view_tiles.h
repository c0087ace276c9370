// Which work groups of view.comp draw which parts of a view. Internal to server/render. Pure.
#pragma once

#include <compare>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "server/render/environment/view.h"
#include "server/vulkan/box.h"
#include "server/vulkan/pipeline.h"
#include "shaders/params.h"

namespace candela {

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
Constants constants_of(const ViewKind& kind, const View& view);

// Work groups x0 to x1 - 1 of a row.
struct ViewRun {
  ViewKind kind;
  uint32_t x0 = 0;
  uint32_t x1 = 0;
};

// The runs of each row of tiles. The sky covers each row, and the objects' runs the tiles that one may touch.
// `objects` are those of the view.
std::vector<std::vector<ViewRun>> view_rows(const View& view, const shader::ViewParams& params,
                                            std::span<const shader::ViewObject> objects);

// The runs of consecutive rows as boxes. `first` is the number of the first row.
std::map<ViewKind, std::vector<Box>> boxes_of(std::span<const std::vector<ViewRun>> rows, uint32_t first);

// About what a row costs, in pixels of a magnified sky.
double cost_of(const std::vector<ViewRun>& row, const View& view);

}  // namespace candela
