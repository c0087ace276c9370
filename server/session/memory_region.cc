#include "server/session/memory_region.h"

#include <fcntl.h>
#include <linux/magic.h>
#include <sys/mman.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <sys/vfs.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// With them nobody can truncate the file, which would kill who reads beyond its end.
constexpr int kSeals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL;

absl::StatusOr<struct stat> check_file(int descriptor) {
  const int seals = fcntl(descriptor, F_GET_SEALS);
  if (seals < 0) return absl::InvalidArgumentError("the region's descriptor is no memfd; pass one");
  if ((seals & kSeals) != kSeals) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the region's seals are %#x; seal it with F_SEAL_SHRINK, F_SEAL_GROW and F_SEAL_SEAL "
                        "(%#x) after its size is set",
                        seals, kSeals));
  }
  struct statfs system {};
  if (fstatfs(descriptor, &system) != 0 || system.f_type == HUGETLBFS_MAGIC) {
    return absl::InvalidArgumentError(
        "the region is in hugetlbfs, where a hole may kill its reader; use ordinary pages");
  }
  struct stat info {};
  if (fstat(descriptor, &info) != 0 || info.st_size < 1 ||
      static_cast<uint64_t>(info.st_size) > v1::kMaxRegionBytes) {
    return absl::InvalidArgumentError(absl::StrFormat("the region has %d bytes; it must have 1 to %d",
                                                      int64_t{info.st_size}, v1::kMaxRegionBytes));
  }
  return info;
}

// The start of `bytes` bytes at `offset`.
absl::StatusOr<std::byte*> area(const char* field, uint64_t offset, uint64_t bytes,
                                const MemoryRegion& region) {
  if (bytes <= region.bytes() && offset <= region.bytes() - bytes && offset % v1::kMemoryAlignment == 0) {
    return region.data() + offset;
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "frame.memory.%s is %d; an area of %d bytes in a region of %d begins at a multiple of %d "
      "and ends within it",
      field, offset, bytes, region.bytes(), v1::kMemoryAlignment));
}

}  // namespace

absl::StatusOr<std::shared_ptr<MemoryRegion>> MemoryRegion::map(int descriptor, const Claim& claim) {
  ASSIGN_OR_RETURN(const struct stat info, check_file(descriptor));
  const auto bytes = static_cast<uint64_t>(info.st_size);
  ASSIGN_OR_RETURN(std::shared_ptr<const void> claimed, claim(bytes));
  // This must not allocate the pages of a client that left holes.
  constexpr uint64_t kBlockBytes = 512;
  const bool whole = static_cast<uint64_t>(info.st_blocks) >= bytes / kBlockBytes;
  void* const at =
      mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | (whole ? MAP_POPULATE : 0), descriptor, 0);
  if (at == MAP_FAILED && (errno == EPERM || errno == EACCES)) {
    return absl::InvalidArgumentError("the region cannot be written; pass it without F_SEAL_WRITE");
  }
  if (at == MAP_FAILED) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("the server cannot map a region of %d bytes: %s", bytes, std::strerror(errno)));
  }
  return std::shared_ptr<MemoryRegion>(
      new MemoryRegion(static_cast<std::byte*>(at), bytes, std::move(claimed)));
}

MemoryRegion::~MemoryRegion() { munmap(data_, bytes_); }

absl::StatusOr<std::string> MemoryRegions::add(std::shared_ptr<MemoryRegion> region) {
  std::string ticket(v1::kMemoryTicketBytes, '\0');
  if (getrandom(ticket.data(), ticket.size(), 0) != static_cast<ssize_t>(ticket.size())) {
    return absl::InternalError("the system has no random bytes for a ticket");
  }
  const absl::MutexLock lock(&mutex_);
  regions_[ticket] = std::move(region);
  return ticket;
}

void MemoryRegions::remove(const std::string& ticket) {
  std::shared_ptr<MemoryRegion> last;  // unmapped without the lock
  const absl::MutexLock lock(&mutex_);
  const auto found = regions_.find(ticket);
  if (found == regions_.end()) return;
  last = std::move(found->second);
  regions_.erase(found);
}

absl::StatusOr<std::shared_ptr<MemoryRegion>> MemoryRegions::find(const std::string& ticket) const {
  const absl::MutexLock lock(&mutex_);
  const auto found = regions_.find(ticket);
  if (found != regions_.end()) return found->second;
  return absl::UnavailableError(
      "frame.memory.ticket is not known to this server; register a region here, or send bands");
}

size_t MemoryRegions::count() const {
  const absl::MutexLock lock(&mutex_);
  return regions_.size();
}

absl::StatusOr<std::optional<ClientPixels>> client_pixels_from(const v1::FrameHeader& header,
                                                               const WireLayout& layout,
                                                               const ImageSize& image,
                                                               v1::OutputFormat format, bool local, bool raw,
                                                               const MemoryRegions& regions) {
  if (!header.has_memory()) return std::nullopt;
  const v1::SharedMemory& asked = header.memory();
  if (asked.ticket().size() != v1::kMemoryTicketBytes) {
    return absl::InvalidArgumentError(absl::StrFormat("frame.memory.ticket has %d bytes; a ticket has %d",
                                                      asked.ticket().size(), v1::kMemoryTicketBytes));
  }
  if (header.has_view() && asked.has_pixels_offset()) {
    return absl::InvalidArgumentError(
        "frame.view and frame.memory.pixels_offset are both set; a view has no pixels");
  }
  if (asked.has_pixels_offset() && layout.format != layout.desc.format) {
    return absl::InvalidArgumentError(
        "frame.format is RGB16F (4) or RGB32F (5) and frame.memory.pixels_offset is set; pixels in memory "
        "have an alpha");
  }
  if (!local) {
    return absl::UnavailableError(
        "frame.memory is set in a call that did not come straight over a unix socket; send bands");
  }
  ASSIGN_OR_RETURN(const std::shared_ptr<MemoryRegion> region, regions.find(asked.ticket()));
  ClientPixels pixels{.owner = region, .row_stride_bytes = layout.row_stride_bytes};
  if (asked.has_pixels_offset()) {
    // The last row's padding need not be there. No product overflows: check_frame has passed.
    const uint64_t bytes =
        layout.row_stride_bytes * (layout.desc.height - uint64_t{1}) + layout.desc.row_bytes();
    ASSIGN_OR_RETURN(pixels.rows, area("pixels_offset", asked.pixels_offset(), bytes, *region));
  }
  if (asked.has_image_offset() && raw) {
    const uint64_t bytes = uint64_t{image.width} * image.height * bytes_per_pixel(format);
    ASSIGN_OR_RETURN(pixels.image, area("image_offset", asked.image_offset(), bytes, *region));
  }
  return pixels;
}

}  // namespace candela
