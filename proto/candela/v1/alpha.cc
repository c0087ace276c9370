#include "proto/candela/v1/alpha.h"

#include <cstdint>
#include <cstring>

#include "server/base/check.h"

namespace candela::v1 {
namespace {

constexpr uint16_t kHalfOne = 0x3c00;
constexpr uint32_t kFloatOne = 0x3f800000;

template <typename Component>
void add(Component one, std::span<const std::byte> row, std::span<std::byte> place) {
  constexpr size_t kRgb = 3 * sizeof(Component), kRgba = 4 * sizeof(Component);
  const size_t width = row.size() / kRgb;
  CHECK(place.size() == width * kRgba);
  for (size_t x = 0; x < width; ++x) {
    std::memcpy(place.data() + x * kRgba, row.data() + x * kRgb, kRgb);
    std::memcpy(place.data() + x * kRgba + kRgb, &one, sizeof(one));
  }
}

template <typename Component>
void leave_out(std::span<const std::byte> row, std::span<std::byte> place) {
  constexpr size_t kRgb = 3 * sizeof(Component), kRgba = 4 * sizeof(Component);
  const size_t width = row.size() / kRgba;
  CHECK(place.size() == width * kRgb);
  for (size_t x = 0; x < width; ++x) std::memcpy(place.data() + x * kRgb, row.data() + x * kRgba, kRgb);
}

}  // namespace

void add_alpha(PixelFormat format, std::span<const std::byte> row, std::span<std::byte> place) {
  CHECK(format == PIXEL_FORMAT_RGB16F || format == PIXEL_FORMAT_RGB32F);
  if (format == PIXEL_FORMAT_RGB16F) return add(kHalfOne, row, place);
  add(kFloatOne, row, place);
}

void add_alpha(OutputFormat format, std::span<const std::byte> row, std::span<std::byte> place) {
  if (format == OUTPUT_FORMAT_RGBA8) return add<uint8_t>(UINT8_MAX, row, place);
  add(format == OUTPUT_FORMAT_RGBA16F ? kHalfOne : uint16_t{UINT16_MAX}, row, place);
}

void leave_out_alpha(OutputFormat format, std::span<const std::byte> row, std::span<std::byte> place) {
  if (format == OUTPUT_FORMAT_RGBA8) return leave_out<uint8_t>(row, place);
  leave_out<uint16_t>(row, place);
}

}  // namespace candela::v1
