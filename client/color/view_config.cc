#include "client/color/view_config.h"

#include <filesystem>
#include <system_error>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/color/lut_config.h"

namespace candela {
namespace {

namespace ocio = OCIO_NAMESPACE;

std::string one_line(const char* text) {
  return absl::StrJoin(absl::StrSplit(text, absl::ByAnyChar("\n\r\t"), absl::SkipWhitespace()), " ");
}

const char* kind_of(const ViewChoice& choice) {
  return choice.lut_input.empty() ? "an OpenColorIO configuration" : "a LUT, such as look.cube";
}

}  // namespace

absl::Status unusable(const ViewChoice& choice, const std::exception& thrown) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: OpenColorIO cannot use it: %s", choice.config, one_line(thrown.what())));
}

absl::StatusOr<ocio::ConstConfigRcPtr> load_config(const ViewChoice& choice) {
  std::error_code failed;
  if (!std::filesystem::exists(choice.config, failed)) {
    return absl::NotFoundError(absl::StrFormat("%s: no such file; %s takes %s", choice.config,
                                               choice.lut_input.empty() ? "--ocio" : "--lut",
                                               kind_of(choice)));
  }
  // OpenColorIO would wait for a pipe's writer.
  if (!std::filesystem::is_regular_file(choice.config, failed)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: not a regular file; name %s", choice.config, kind_of(choice)));
  }
  ocio::SetLoggingLevel(ocio::LOGGING_LEVEL_NONE);
  try {
    return choice.lut_input.empty() ? ocio::Config::CreateFromFile(choice.config.c_str())
                                    : lut_config(choice);
  } catch (const std::exception& thrown) {
    return unusable(choice, thrown);
  }
}

}  // namespace candela
