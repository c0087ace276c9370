#include "tests/fuzz/wire_memory.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <memory>
#include <string>

#include "proto/candela/v1/pixel_size.h"
#include "server/session/memory_region.h"
#include "tests/fuzz/expect.h"

namespace candela {
namespace {

constexpr uint64_t kRegionBytes = 65536;

struct Registered {
  Registered() {
    const int memfd = memfd_create("fuzz", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    expect(ftruncate(memfd, kRegionBytes) == 0, "a region has its size");
    fcntl(memfd, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL);
    const auto claim = [](uint64_t) -> absl::StatusOr<std::shared_ptr<const void>> { return nullptr; };
    region = MemoryRegion::map(memfd, claim).value();
    close(memfd);
    ticket = regions.add(region).value();
  }
  MemoryRegions regions;
  std::shared_ptr<MemoryRegion> region;
  std::string ticket;
};

void expect_inside(const std::byte* begin, uint64_t bytes, const MemoryRegion& region) {
  if (begin == nullptr) return;
  const auto offset = static_cast<uint64_t>(begin - region.data());
  expect(begin >= region.data() && offset <= region.bytes() && bytes <= region.bytes() - offset,
         "an area is inside its region");
}

}  // namespace

void place_in_memory(v1::FrameHeader header, const RenderStart& start) {
  static const Registered* const kRegistered = new Registered;
  if (!header.has_memory()) return;
  if (header.memory().ticket().size() % 2 == 0) header.mutable_memory()->set_ticket(kRegistered->ticket);
  const ImageSize image = image_size(*start.settings, start.layout.desc);
  const v1::OutputFormat format = start.settings->output_format();
  const absl::StatusOr<std::optional<ClientPixels>> pixels =
      client_pixels_from(header, start.layout, image, format, /*local=*/true,
                         /*raw=*/true, kRegistered->regions);
  if (!pixels.ok()) {
    expect(absl::IsInvalidArgument(pixels.status()) || absl::IsUnavailable(pixels.status()),
           "a place is refused with one of its codes", pixels.status().ToString());
    return;
  }
  expect_inside((*pixels)->rows,
                start.layout.row_stride_bytes * (start.layout.desc.height - 1) + start.layout.row_bytes(),
                *kRegistered->region);
  expect_inside((*pixels)->image, uint64_t{image.width} * image.height * bytes_per_pixel(format),
                *kRegistered->region);
}

}  // namespace candela
