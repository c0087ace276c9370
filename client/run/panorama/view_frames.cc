#include "client/run/panorama/view_frames.h"

#include "client/run/picture/picture_size.h"
#include "client/run/sequence/frame_numbers.h"

namespace candela {

std::optional<SourceFrame> ViewFrames::next() {
  if (next_ == scene_.frames()) return std::nullopt;
  const uint64_t index = next_++;
  SourceFrame made;
  made.settings = settings_;
  made.facts = {
      .number = static_cast<int64_t>(index),
      .input = options_.panorama,
      .place = index,
      .media_time_ns = media_time_ns(index, scene_.rate()),
      .exposure_given = exposure_.has_value(),
      .size = {options_.width, options_.height},
      .pixel_aspect = image_pixel_aspect({options_.width, options_.height}, 1, settings_.output_size()),
      .frame_rate = scene_.rate(),
      .primaries = file_.primaries,
      .missing_pixels = file_.missing_pixels};
  made.frame = {.width = options_.width,
                .height = options_.height,
                .sequence = index,
                .media_time_ns = made.facts.media_time_ns,
                .exposure = exposure_,
                .view = scene_.view(environment_, index),
                .panorama = file_.panorama};
  return made;
}

}  // namespace candela
