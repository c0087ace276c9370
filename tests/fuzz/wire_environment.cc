#include "tests/fuzz/wire_environment.h"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "candela/v1/render.pb.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/environment_id.h"
#include "proto/candela/v1/limits.h"
#include "server/rpc/band_reader.h"
#include "server/session/environment_start.h"
#include "tests/fuzz/expect.h"
#include "tests/fuzz/wire_slices.h"
#include "tests/support/clock/real_clock.h"

namespace candela {
namespace {

void check_panorama(const PanoramaStart& start) {
  const FrameDesc& desc = start.layout.desc;
  expect(desc.width >= 1 && desc.width <= v1::kMaxPanoramaWidth, "the panorama's width is within the limits");
  expect(desc.height >= 1 && desc.height <= v1::kMaxPanoramaHeight,
         "the panorama's height is within the limits");
  expect(start.layout.row_stride_bytes >= desc.row_bytes(), "the panorama's rows hold their pixels");
}

void check_bake(const BakeStart& start) {
  const uint32_t size = start.spec.size;
  expect(size == 0 || (std::has_single_bit(size) && size >= v1::kCubeSize.min && size <= v1::kCubeSize.max),
         "a cube's size is a power of two within its range");
  expect(start.spec.quality.cube_samples > 0 && start.spec.quality.specular_detail > 0,
         "a bake has a quality");
  expect(start.format == v1::PIXEL_FORMAT_RGBA16F || start.format == v1::PIXEL_FORMAT_RGBA32F ||
             start.format == v1::PIXEL_FORMAT_RGB9E5,
         "a bake has one of its formats");
}

}  // namespace

void put_environment(const WireInput& input) {
  const std::span<const std::string> messages = input.messages;
  if (messages.empty()) return;
  grpc::ByteBuffer first = in_slices(messages[0], input.slice_bytes);
  v1::PutEnvironmentRequest request;
  if (!parse_request(first, request).ok() || !request.has_start()) return;
  const absl::StatusOr<PanoramaStart> start = panorama_start_from(request.start(), kLimits);
  if (!start.ok()) {
    expect(absl::IsInvalidArgument(start.status()) || absl::IsResourceExhausted(start.status()),
           "a panorama is refused with one of its codes", start.status().ToString());
    return;
  }
  check_panorama(*start);
  const FrameDesc& desc = start->layout.desc;
  v1::EnvironmentId id(request.start());
  BandReader reader(v1::kPanoramaBand, start->layout, testing::real_clock());
  std::vector<std::byte> place(desc.row_bytes());
  uint32_t rows = 0;
  for (const std::string& message : messages.subspan(1)) {
    grpc::ByteBuffer buffer = in_slices(message, input.slice_bytes);
    const uint32_t begin = rows;
    const absl::Status status = reader.read(buffer, [&](uint32_t y) -> std::span<std::byte> {
      // Of repeated fields the last counts, so a band may begin again.
      expect((y == rows || y == begin) && y < desc.height, "a row is the one that is due");
      rows = y + 1;
      return place;
    });
    if (!status.ok()) {
      expect(absl::IsInvalidArgument(status), "a band is refused as an invalid argument", status.ToString());
      return;
    }
    id.add(place);
  }
  expect(reader.check_complete().ok() == (rows == desc.height), "the panorama is whole with its last row");
  expect(v1::is_environment_id(id.finish()), "an id has the form of one");
}

void use_environment(const WireInput& input) {
  if (input.messages.empty()) return;
  grpc::ByteBuffer first = in_slices(input.messages[0], input.slice_bytes);
  v1::BakeEnvironmentRequest bake;
  if (parse_request(first, bake).ok()) {
    const absl::StatusOr<BakeStart> start = bake_start_from(bake);
    if (start.ok()) check_bake(*start);
    expect(start.ok() || absl::IsInvalidArgument(start.status()), "a bake is refused with its code",
           start.status().ToString());
  }
  first = in_slices(input.messages[0], input.slice_bytes);
  v1::RenderRequest frame;
  if (!parse_request(first, frame).ok() || !frame.start().frame().has_view()) return;
  const absl::StatusOr<View> view = view_from(frame.start().frame().view());
  expect(view.ok() || absl::IsInvalidArgument(view.status()), "a view is refused with its code",
         view.status().ToString());
  if (view.ok()) expect(check_view(*view).ok(), "a view that is taken can be rendered");
}

}  // namespace candela
