#include "client/image/describe.h"

#include <utility>

#include "client/base/failure.h"
#include "client/image/primaries.h"
#include "client/image/read/file_reader.h"
#include "client/image/read/readers.h"

namespace candela {

namespace {

absl::StatusOr<FileFacts> describe_any_image(const std::string& path, const ImageLimits& limits) {
  absl::StatusOr<FileReader> file = FileReader::open(path);
  if (!file.ok()) return file.status();
  const absl::StatusOr<FileKind> kind = file_kind(*file);
  if (!kind.ok()) return kind.status();
  if (*kind == FileKind::kExr) return describe_exr(*file, limits);

  const bool radiance = *kind == FileKind::kRadiance;
  const absl::StatusOr<Image> image = radiance ? read_radiance(*file, limits) : read_pfm(*file, limits);
  if (!image.ok()) return image.status();
  const WindowFacts window{0, 0, int64_t{image->width} - 1, int64_t{image->height} - 1};
  PartFacts part{.storage = "scan lines",
                 .display = window,
                 .data = window,
                 .pixel_aspect = image->pixel_aspect,
                 .chromaticities = image->chromaticities};
  if (image->names_primaries && !image->chromaticities) part.chromaticities = kRec709.xy;
  return FileFacts{.kind = radiance ? "Radiance" : "PFM",
                   .parts = {std::move(part)},
                   .renderable = absl::OkStatus(),
                   .shown = "the whole picture",
                   .notes = image->notes};
}

}  // namespace

absl::StatusOr<FileFacts> describe_image(const std::string& path, const ImageLimits& limits) {
  absl::StatusOr<FileFacts> facts = describe_any_image(path, limits);
  if (facts.ok()) return facts;
  return input_failure(facts.status(), path);
}

}  // namespace candela
