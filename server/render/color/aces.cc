#include "server/render/color/aces.h"

#include <OpenColorIO/OpenColorIO.h>

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "server/base/slices.h"
#include "server/base/status_macros.h"

namespace candela {

namespace {

namespace ocio = OCIO_NAMESPACE;

// Exposed light beyond this maps to white, whatever its colour, and would leave a float's range in the
// transform. Negative light has the same limit.
constexpr float kMaxLight = 0x1p40f;
// The end of the table's axes. The tone curve is flat from 16.3 on; beyond that only the hue changes.
constexpr float kTableEnd = 32.0f;
// AP1's own axes come before the RRT's desaturation, so there a brighter light still changes.
constexpr float kWideTableEnd = 320.0f;

void append(const ocio::GroupTransformRcPtr& group, const char* style, ocio::TransformDirection direction) {
  const ocio::BuiltinTransformRcPtr builtin = ocio::BuiltinTransform::Create();
  builtin->setStyle(style);
  builtin->setDirection(direction);
  group->appendTransform(builtin);
}

absl::StatusOr<ocio::ConstCPUProcessorRcPtr> make_processor() {
  try {
    const ocio::GroupTransformRcPtr group = ocio::GroupTransform::Create();
    append(group, "UTILITY - ACES-AP1_to_LINEAR-REC709_BFD", ocio::TRANSFORM_DIR_INVERSE);
    append(group, "ACEScg_to_ACES2065-1", ocio::TRANSFORM_DIR_FORWARD);
    append(group, "ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO_1.0", ocio::TRANSFORM_DIR_FORWARD);
    append(group, "UTILITY - ACES-AP1_to_CIE-XYZ-D65_BFD", ocio::TRANSFORM_DIR_INVERSE);
    append(group, "UTILITY - ACES-AP1_to_LINEAR-REC709_BFD", ocio::TRANSFORM_DIR_FORWARD);
    // Lossless: logarithms and powers are not approximated.
    return ocio::Config::CreateRaw()->getProcessor(group)->getOptimizedCPUProcessor(
        ocio::OPTIMIZATION_LOSSLESS);
  } catch (const std::exception& error) {
    return absl::FailedPreconditionError(absl::StrCat("aces-1 is not in this OpenColorIO, version ",
                                                      ocio::GetVersion(), ": ", error.what(),
                                                      "; install 2.1 or later, or choose another curve"));
  }
}

absl::StatusOr<std::shared_ptr<const ColorTable>> bake(uint32_t size, uint32_t axes, float end) {
  constexpr size_t kPiece = 3 * 8192;  // components; about 3 ms
  std::vector<float> rgb = lattice_light(size, axes, end);
  for (std::span<float> rest = rgb; !rest.empty(); rest = rest.subspan(std::min(kPiece, rest.size()))) {
    checkpoint();
    RETURN_IF_ERROR(aces_1(rest.first(std::min(kPiece, rest.size()))));
  }
  checkpoint();
  return std::make_shared<const ColorTable>(make_color_table(size, axes, end, rgb));
}

// Two threads that request a new table at the same time both bake it, because baking may pause.
absl::StatusOr<std::shared_ptr<const ColorTable>> kept_table(uint32_t size, uint32_t axes, float end) {
  static absl::Mutex& mutex = *new absl::Mutex;
  static auto& tables = *new std::map<std::pair<uint32_t, uint32_t>, std::shared_ptr<const ColorTable>>;
  {
    const absl::MutexLock lock(&mutex);
    if (const auto kept = tables.find({size, axes}); kept != tables.end()) return kept->second;
  }
  absl::StatusOr<std::shared_ptr<const ColorTable>> table = bake(size, axes, end);
  if (!table.ok()) return table;
  const absl::MutexLock lock(&mutex);
  return tables.try_emplace({size, axes}, *std::move(table)).first->second;
}

}  // namespace

absl::Status aces_1(std::span<float> rgb) {
  static const absl::StatusOr<ocio::ConstCPUProcessorRcPtr>& processor =
      *new absl::StatusOr<ocio::ConstCPUProcessorRcPtr>(make_processor());
  if (!processor.ok()) return processor.status();
  if (rgb.empty()) return absl::OkStatus();
  for (float& v : rgb) v = std::clamp(v, -kMaxLight, kMaxLight);
  try {
    ocio::PackedImageDesc image(rgb.data(), static_cast<long>(rgb.size() / 3), 1, 3);
    (*processor)->apply(image);
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat("OpenColorIO: ", error.what()));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::shared_ptr<const ColorTable>> aces_1_table(uint32_t size) {
  return kept_table(size, shader::AXES_ACES, kTableEnd);
}

absl::StatusOr<std::shared_ptr<const ColorTable>> aces_1_wide_table(uint32_t size) {
  return kept_table(size, shader::AXES_AP1, kWideTableEnd);
}

}  // namespace candela
