// Memory for pixels, in large pages where the system has them: one of 2 MiB takes one fault in place of 512.
// From a megabyte on, memory that is freed is kept for the next that asks to overwrite as much, or less down
// to a third. What is kept never makes this process hold more than it once used at the same time, nor more
// than kMostIdlePixels. The system takes it when it is short of memory. Any thread.
#pragma once

#include <cstddef>
#include <memory>

namespace candela {

inline constexpr size_t kMostIdlePixels = size_t{256} << 20;  // bytes

struct FreePixels {
  void* mapping = nullptr;  // null: the memory is from calloc()
  size_t mapped_bytes = 0;
  mutable std::shared_ptr<const void> owner = nullptr;  // if set, it has the memory, and is let go
  void operator()(std::byte* pixels) const;
};
using PixelMemory = std::unique_ptr<std::byte[], FreePixels>;

// `bytes` zeros, never kept ones: what is not written takes no memory. Null if there is none. From a megabyte
// on it begins with a large page.
PixelMemory new_pixels(size_t bytes);

// The same, but it may hold the pixels of another picture. The caller writes every byte before any is read,
// or frees it.
PixelMemory pixels_to_overwrite(size_t bytes);

// The bytes that are kept now.
size_t idle_pixels();

}  // namespace candela
