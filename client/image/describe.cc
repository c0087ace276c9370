#include "client/image/describe.h"

#include <utility>

#include "client/base/failure.h"
#include "client/image/primaries.h"
#include "client/image/read/file_reader.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {

namespace {

absl::StatusOr<FileFacts> describe_any_image(const std::string& path, const ImageLimits& limits) {
  ASSIGN_OR_RETURN(FileReader file, FileReader::open(path));
  ASSIGN_OR_RETURN(const FileKind kind, file_kind(file));
  if (kind == FileKind::kExr) return describe_exr(file, limits);

  const bool radiance = kind == FileKind::kRadiance;
  ASSIGN_OR_RETURN(const Image image, radiance ? read_radiance(file, limits) : read_pfm(file, limits));
  const WindowFacts window{0, 0, int64_t{image.width} - 1, int64_t{image.height} - 1};
  PartFacts part{.storage = "scan lines",
                 .display = window,
                 .data = window,
                 .pixel_aspect = image.pixel_aspect,
                 .chromaticities = image.chromaticities};
  if (image.names_primaries && !image.chromaticities) part.chromaticities = kRec709.xy;
  return FileFacts{.kind = radiance ? "Radiance" : "PFM",
                   .parts = {std::move(part)},
                   .renderable = absl::OkStatus(),
                   .shown = "the whole picture",
                   .notes = image.notes};
}

}  // namespace

absl::StatusOr<FileFacts> describe_image(const std::string& path, const ImageLimits& limits) {
  absl::StatusOr<FileFacts> facts = describe_any_image(path, limits);
  if (facts.ok()) return facts;
  return input_failure(facts.status(), path);
}

}  // namespace candela
