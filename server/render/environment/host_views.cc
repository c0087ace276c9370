#include "server/render/environment/host_views.h"

#include <algorithm>
#include <vector>

#include "server/render/environment/view_scene.h"
#include "server/render/environment/view_tiles.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/host/view/view.h"

namespace candela {

namespace {

const float* texels_of(const CubeLevels& levels) {
  return levels ? reinterpret_cast<const float*>(levels.texels.buffer().mapped()) : nullptr;
}

std::vector<host::ViewPart> parts_of(const std::vector<ViewRun>& runs) {
  std::vector<host::ViewPart> parts;
  for (const ViewRun& run : runs) {
    const uint32_t columns = run.kind.objects ? shader::VIEW_TILE : shader::VIEW_SKY_X;
    parts.push_back({run.x0 * columns, run.x1 * columns, run.kind.objects, run.kind.magnified,
                     run.kind.first_object, run.kind.end_object});
  }
  return parts;
}

}  // namespace

void draw_on_host(const BakedCube& cube, bool floats, const View& view, const shader::ViewLight& light,
                  std::span<const shader::ViewObject> objects, FrameMemory& memory, Crew& crew) {
  const TextureLayout& layout = memory.textures().layout;
  const host::ViewJob job = {
      .params = view_params(view, layout.desc.width, layout.desc.height, layout.pitch, cube.chain.size),
      .chain = texels_of(cube.chain),
      .specular = texels_of(cube.specular),
      .light = light,
      .objects = objects,
      .pixels = memory.textures().input.buffer().mapped(),
      .floats = floats};
  const ViewTiles tiles(view, job.params, objects);
  const auto draw_row = [&](uint32_t y) {
    const uint32_t y0 = y * shader::VIEW_TILE;
    host::draw_view_rows(job, parts_of(tiles.row(y)), y0,
                         std::min(y0 + shader::VIEW_TILE, layout.desc.height));
  };
  crew.run(tiles.rows(), draw_row);
}

}  // namespace candela
