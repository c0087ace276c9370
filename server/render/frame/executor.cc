#include "server/render/frame/executor.h"

#include "server/base/check.h"
#include "server/render/frame/frame_textures.h"

namespace candela {

absl::StatusOr<Metered> Executor::meter(FrameMemory& memory, const IngestPlan& plan) {
  FrameTextures& textures = memory.textures();
  CHECK(textures.stage != FrameStage::kOutputOnly);
  if (textures.client.rows != nullptr && !copies_rows()) {
    textures.copy_rows(textures.client, 0, textures.layout.desc.height);
    textures.client.rows = nullptr;
  }
  absl::StatusOr<Metered> metered = run_meter(memory, plan);
  if (metered.ok()) textures.stage = FrameStage::kMetered;
  return metered;
}

absl::StatusOr<Drawn> Executor::draw(FrameMemory& memory, const Plan& plan, std::vector<StageTime>* stages) {
  FrameTextures& textures = memory.textures();
  CHECK(textures.stage == FrameStage::kMetered || textures.stage == FrameStage::kDrawn);
  textures.client_has_image = false;
  absl::StatusOr<Drawn> drawn = run_draw(memory, plan, stages);
  if (drawn.ok()) textures.stage = FrameStage::kDrawn;
  return drawn;
}

}  // namespace candela
