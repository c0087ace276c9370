// The bytes of an image. New memory is zero, and pages that are never written take no memory, because
// calloc() gets big blocks as zero pages from the system. So a reader needs to fill only what the file holds.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <span>
#include <utility>

namespace candela {

// Move-only; not thread-safe. A buffer that could not be allocated has size() 0.
class PixelBuffer {
 public:
  PixelBuffer() = default;
  explicit PixelBuffer(size_t bytes)
      : bytes_(static_cast<std::byte*>(std::calloc(bytes, 1))), size_(bytes_ ? bytes : 0) {}
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
  struct Free {
    void operator()(std::byte* p) const { std::free(p); }
  };
  std::unique_ptr<std::byte[], Free> bytes_;
  size_t size_ = 0;
};

}  // namespace candela
