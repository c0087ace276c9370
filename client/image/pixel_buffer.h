// The bytes of an image.
#pragma once

#include <cstddef>
#include <span>
#include <utility>

#include "server/base/process/pixel_memory.h"

namespace candela {

// Move-only; not thread-safe. A buffer that could not be allocated has size() 0.
class PixelBuffer {
 public:
  PixelBuffer() = default;
  // Zeros, and what is never written takes no memory. So a reader needs to fill only what the file holds.
  explicit PixelBuffer(size_t bytes) : PixelBuffer(new_pixels(bytes), bytes) {}
  PixelBuffer(PixelMemory memory, size_t bytes) : bytes_(std::move(memory)), size_(bytes_ ? bytes : 0) {}
  PixelBuffer(PixelBuffer&& other) noexcept
      : bytes_(std::move(other.bytes_)), size_(std::exchange(other.size_, 0)) {}
  PixelBuffer& operator=(PixelBuffer&& other) noexcept {
    bytes_ = std::move(other.bytes_);
    size_ = std::exchange(other.size_, 0);
    return *this;
  }

  std::byte* data() { return bytes_.get(); }
  const std::byte* data() const { return bytes_.get(); }
  size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  std::span<const std::byte> span() const { return {data(), size_}; }
  std::span<std::byte> span() { return {data(), size_}; }

 private:
  PixelMemory bytes_;
  size_t size_ = 0;
};

}  // namespace candela
