// The views of EnvironmentBaker.
#include <algorithm>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/candela/v1/settings.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/render/environment/environment_baker.h"
#include "server/render/environment/host_views.h"
#include "server/render/environment/view_scene.h"
#include "server/render/environment/view_tiles.h"
#include "server/render/frame/frame_textures.h"
#include "shaders/view.spv.h"

namespace candela {

static_assert(sizeof(shader::ViewParams) <= PipelineCache::kPushBytes);

namespace {

// In look-ups. A thread of the host does so many in 10 to 25 ms, and the software device in 50.
constexpr double kMostAtOnce = 1e7;

}  // namespace

absl::Status EnvironmentBaker::prepare_view(Environment& environment, const BakeQuality& quality,
                                            bool objects) {
  if (objects) {
    RETURN_IF_ERROR(brdf_table().status());
  }
  BakedCube& view = environment.view;
  const BakeQuality sky = {quality.cube_samples, 0.0};
  if (!view.chain || (view.spec.quality != quality && view.spec.quality != sky)) {
    view = {};
    ASSIGN_OR_RETURN(view, bake(environment, {.size = view_cube_size(environment.width),
                                              .mapping = RoughnessMapping::kPerceptual,
                                              .quality = objects ? quality : sky}));
  }
  if (!objects || view.spec.quality == quality) return absl::OkStatus();
  BakeSpec spec = view.spec;
  spec.quality = quality;
  ASSIGN_OR_RETURN(view.specular, make_specular(spec, view.chain));
  view.spec = spec;
  return absl::OkStatus();
}

absl::Status EnvironmentBaker::render_view(Environment& environment, const View& view, FrameMemory& memory) {
  RETURN_IF_ERROR(check_view(view));
  const bool with_objects = !view.objects.empty();
  if (!environment.view.chain || (with_objects && environment.view.spec.quality.specular_detail == 0.0)) {
    return absl::FailedPreconditionError("the environment has no levels for this view");
  }
  if (const v1::PixelFormat format = view_format(environment); memory.desc().format != format) {
    return absl::InvalidArgumentError(
        absl::StrCat("a view of this environment is a frame of ", v1::word_of(format)));
  }
  CHECK(memory.textures().stage != FrameStage::kOutputOnly);
  ASSIGN_OR_RETURN(const Harmonics light, radiance(environment));
  absl::StatusOr<std::span<const uint16_t>> brdf = std::span<const uint16_t>();
  if (with_objects) brdf = brdf_table();
  if (!brdf.ok()) return brdf.status();
  const std::vector<shader::ViewObject> objects = view_objects(view, environment.view.specular, *brdf);
  const shader::ViewLight irradiance = view_light(irradiance_of(light));
  if (crew_ != nullptr) {
    if (device_.lost()) {
      return absl::UnavailableError(absl::StrCat("Vulkan device lost: ", device_.summary().name));
    }
    draw_on_host(environment.view, environment.floats, view, irradiance, objects, memory, *crew_);
    return absl::OkStatus();
  }
  ASSIGN_OR_RETURN(const TexturePool::Lease scene, passes_.upload(view_scene(irradiance, objects)));
  absl::Status status = draw_view(environment, view, objects, scene.buffer(), memory);
  const FrameTextures& textures = memory.textures();
  if (!status.ok() || !textures.upload) return status;
  // Whoever renders the frame takes its pixels from here, like those of the wire.
  return passes_.copy(textures.input.buffer(), textures.upload.buffer());
}

bool EnvironmentBaker::takes_long(const View& view, const FrameDesc& desc) {
  return most_cost_of_row(view, desc.width) * desc.height / shader::VIEW_TILE > kMostAtOnce;
}

absl::Status EnvironmentBaker::draw_view(const Environment& environment, const View& view,
                                         std::span<const shader::ViewObject> objects, const Buffer& scene,
                                         FrameMemory& memory) {
  const TextureLayout& layout = memory.textures().layout;
  const Buffer& input = memory.textures().input.buffer();
  shader::ViewParams params =
      view_params(view, layout.desc.width, layout.desc.height, layout.pitch, environment.view.chain.size);
  const VkBufferView chain = environment.view.chain.texels.buffer().view();
  const CubeLevels& specular = environment.view.specular;
  // Without specular levels nothing reads them, but the binding still has to hold something.
  const VkBufferView reads[] = {chain, specular ? specular.texels.buffer().view() : chain, scene.view()};
  const ViewTiles tiles(view, params, objects);
  std::vector<std::vector<ViewRun>> rows;
  for (uint32_t y = 0; y < tiles.rows(); ++y) rows.push_back(tiles.row(y));
  const uint64_t row_bytes = uint64_t{layout.pitch} * bytes_per_pixel(layout.desc.format);
  const auto record = [&](uint32_t begin, uint32_t end) -> absl::Status {
    params.first_row = begin * shader::VIEW_TILE;
    const uint32_t last = std::min(end * shader::VIEW_TILE, layout.desc.height);
    const VkDescriptorBufferInfo written = {input.handle(), params.first_row * row_bytes,
                                            (last - params.first_row) * row_bytes};
    bool over_sky = false;
    for (const auto& [kind, boxes] : boxes_of(std::span(rows).subspan(begin, end - begin), begin)) {
      ASSIGN_OR_RETURN(const VkPipeline pipeline,
                       passes_.pipelines().get(k_view_spirv, constants_of(kind, view, environment.floats)));
      if (kind.objects && !std::exchange(over_sky, true)) passes_.recorder().barrier();
      params.first_object = kind.first_object;
      params.end_object = kind.end_object;
      passes_.recorder().bind(pipeline, passes_.pipelines().layout(), reads, written, &params, sizeof params);
      for (const Box& box : boxes) passes_.recorder().dispatch(box.x0, box.y0, box.x1, box.y1);
    }
    return absl::OkStatus();
  };
  return passes_.run(
      {.spirv = k_view_spirv,
       .count = static_cast<uint32_t>(rows.size()),
       .cost = [&](uint32_t y) { return cost_of(rows[y], view); },
       .record = record,
       .most = static_cast<uint32_t>(PipelineCache::kMaxWriteBytes / row_bytes / shader::VIEW_TILE)});
}

}  // namespace candela
