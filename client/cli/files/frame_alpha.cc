#include "client/cli/files/frame_alpha.h"

namespace candela {

bool keeps_alpha(const v1::Settings& settings) {
  return settings.alpha() != v1::ALPHA_OVER && settings.alpha() != v1::ALPHA_IGNORE;
}

std::string ignore_empty_alpha(const Image& frame, v1::Settings& settings) {
  if (!frame.has_alpha || !alpha_hides_everything(frame)) return "";
  settings.set_alpha(v1::ALPHA_IGNORE);
  return "alpha ignored: it is 0 everywhere and would hide the whole picture; --alpha straight uses it";
}

}  // namespace candela
