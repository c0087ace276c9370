#include "server/render/host/ingest/ingest.h"

#include <cstring>

#include "server/render/plan/metering.h"

namespace candela::host {

IngestWork ingest_work(const IngestPlan& plan, const IngestRead& read, const FrameTextures& textures) {
  IngestWork work{.constants = plan.inputs.constants, .params = plan.inputs.params};
  work.constants.scrub = read.scrub;
  work.constants.alpha = read.alpha;
  work.wire = textures.input.buffer().mapped();
  work.tiles = reinterpret_cast<shader::TileRecord*>(textures.tiles.buffer().mapped());
  if (work.constants.weights == shader::WEIGHTS_CENTER) work.center_weights = center_weights();
  if (textures.histogram) {
    std::byte* bins = textures.histogram.buffer().mapped();
    std::memset(bins, 0, textures.layout.histogram_bytes(read.scrub));
    work.histogram = reinterpret_cast<shader::HistogramBin*>(bins);
  }
  return work;
}

}  // namespace candela::host
