#include "client/panorama.h"

#include "client/call/channel.h"
#include "proto/candela/v1/environment_id.h"

namespace candela {

absl::Status check_panorama(const Panorama& panorama) {
  return check_frame(panorama.start.width(), panorama.start.height(), panorama.start.format(),
                     panorama.pixels.size());
}

std::string environment_id(const Panorama& panorama) {
  v1::EnvironmentId id(panorama.start);
  id.add(panorama.pixels);
  return id.finish();
}

}  // namespace candela
