// Views of environments on the host: shaders/environment/view.comp for a row of tiles. The mathematics are
// those of docs/environments.md section 6, for the most part the shader's own text.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "shaders/environment/environment_params.h"

namespace candela::host {

// What the pass reads and writes, all of it mapped. Of `params` it does not use first_row, first_object and
// end_object.
struct ViewJob {
  shader::ViewParams params{};
  const float* chain = nullptr;     // four floats a texel
  const float* specular = nullptr;  // the same; null without specular levels
  shader::ViewLight light{};
  std::span<const shader::ViewObject> objects{};
  std::byte* pixels = nullptr;  // RGBA halves or floats, rows params.pitch apart
  bool floats = false;
};

// What is drawn in the columns x0 <= x < x1 of some rows: objects, or the sky.
struct ViewPart {
  uint32_t x0 = 0;
  uint32_t x1 = 0;
  bool objects = false;
  bool magnified = false;     // the sky is level 0
  uint32_t first_object = 0;  // those that may be seen in the part
  uint32_t end_object = 0;
};

// Draws rows y0 <= y < y1, part after part: the sky's parts cover each row, and the objects' follow them. Any
// thread. The bits do not depend on how the rows are split. Needs instruction_set().
void draw_view_rows(const ViewJob& job, std::span<const ViewPart> parts, uint32_t y0, uint32_t y1);

}  // namespace candela::host
