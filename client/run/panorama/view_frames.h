// The frames of a camera that moves in a panorama.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "client/run/frames/frame_source.h"
#include "client/run/options.h"
#include "client/run/panorama/panorama_file.h"
#include "client/run/panorama/view_scene.h"

namespace candela {

class ViewFrames : public FrameSource {
 public:
  // `environment` is the id of the panorama `file` on the server. `exposure` is that of all frames, if it is
  // given. The options, the scene and the file must outlive this.
  ViewFrames(const PanoramaViewOptions& options, const ViewScene& scene, const PanoramaFile& file,
             std::string environment, std::optional<double> exposure)
      : options_(options),
        scene_(scene),
        file_(file),
        environment_(std::move(environment)),
        exposure_(exposure),
        settings_(without_panorama(options.settings)) {}

  uint64_t frames() const override { return scene_.frames(); }
  std::optional<SourceFrame> next() override;

 private:
  const PanoramaViewOptions& options_;
  const ViewScene& scene_;
  const PanoramaFile& file_;
  const std::string environment_;
  const std::optional<double> exposure_;
  const v1::Settings settings_;
  uint64_t next_ = 0;
};

}  // namespace candela
