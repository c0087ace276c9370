// Memory for pixels, in large pages where the system has them: a page of 2 MiB takes one fault in place of
// 512. From a megabyte on, freed memory goes into a reserve and not back to the system. pixels_to_overwrite()
// takes memory from the reserve that is as large as asked for, or up to three times as large. The reserve
// never makes this process larger than it once was, and never holds more than kMostIdlePixels. The system may
// take its pages when it is short of memory. Any thread.
#pragma once

#include <cstddef>
#include <memory>

namespace candela {

inline constexpr size_t kMostIdlePixels = size_t{256} << 20;  // bytes

struct FreePixels {
  void* mapping = nullptr;  // null: the memory is from calloc()
  size_t mapped_bytes = 0;
  mutable std::shared_ptr<const void> owner = nullptr;  // if set, it owns the memory, and freeing releases it
  void operator()(std::byte* pixels) const;
};
using PixelMemory = std::unique_ptr<std::byte[], FreePixels>;

// `bytes` zeros, never from the reserve, so pages that are not written take no memory. Null if there is none.
// From a megabyte on it begins with a large page.
PixelMemory new_pixels(size_t bytes);

// The same, but it may hold the pixels of another picture. The caller writes every byte before any is read,
// or frees it.
PixelMemory pixels_to_overwrite(size_t bytes);

// The bytes in the reserve.
size_t idle_pixels();

}  // namespace candela
