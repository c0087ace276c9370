// Rows of pixels as Band.zstd holds them: the same bits in fewer bytes. docs/transport.md defines the form.
#pragma once

#include <grpcpp/support/slice.h>
#include <zstd.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"

namespace candela::v1 {

// Used by one thread at a time. It keeps its memory, about 5 MiB, for the next rows.
class RowPacker {
 public:
  // `rows` are tight rows of a known format, 1 .. kMaxBandBytes bytes. The result may be larger than they
  // are.
  grpc::Slice pack(std::span<const std::byte> rows, uint32_t width, PixelFormat format);

 private:
  struct Free {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  };
  const std::unique_ptr<ZSTD_CCtx, Free> context_{ZSTD_createCCtx()};
  std::vector<std::byte> planes_, packed_;
};

// Used by one thread at a time. It keeps its memory, about 2 MiB, for the next rows.
class RowUnpacker {
 public:
  // The bytes that the rows in `packed` say they have, 0 .. kMaxBandBytes. INVALID_ARGUMENT if they say
  // nothing or more.
  static absl::StatusOr<uint64_t> unpacked_bytes(std::span<const std::byte> packed);

  // Takes rows of `width` pixels. `bytes` is what unpacked_bytes() has said, and whole rows. INVALID_ARGUMENT
  // if they are damaged.
  absl::Status begin(std::span<const std::byte> packed, uint64_t bytes, uint32_t width, PixelFormat format);
  // Copies row y of them to `place`, which is as long as a tight row.
  void read(uint32_t y, std::span<std::byte> place) const;

 private:
  struct Free {
    void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
  };
  const std::unique_ptr<ZSTD_DCtx, Free> context_{ZSTD_createDCtx()};
  std::vector<std::byte> planes_;
  uint32_t width_ = 0;
  PixelFormat format_ = PIXEL_FORMAT_UNSPECIFIED;
};

}  // namespace candela::v1
