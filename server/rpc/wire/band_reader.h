// A reader of the bands of one frame.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "proto/candela/v1/band_wire.h"
#include "server/render/settings/frame.h"

namespace candela {

// Not thread-safe.
class BandReader {
 public:
  // Returns where a row goes: desc.row_bytes() bytes.
  using Row = absl::FunctionRef<std::span<std::byte>(uint32_t y)>;

  // `desc` has passed check_frame. Rows arrive `row_stride_bytes` apart; the bytes after a tight row are
  // dropped.
  BandReader(v1::BandKind kind, const FrameDesc& desc, uint64_t row_stride_bytes)
      : kind_(kind), desc_(desc), stride_bytes_(row_stride_bytes) {}

  // Copies the band's rows to their places. INVALID_ARGUMENT if the band does not hold whole rows, does not
  // begin where the last one ended, or exceeds the frame.
  absl::Status read(grpc::ByteBuffer& message, Row row);

  bool complete() const { return rows_ == desc_.height; }
  // OK if every row has arrived, else INVALID_ARGUMENT with the number of rows.
  absl::Status check_complete() const;

 private:
  absl::StatusOr<uint32_t> count_rows(uint64_t bytes) const;

  const v1::BandKind kind_;
  const FrameDesc desc_;
  const uint64_t stride_bytes_;
  uint32_t rows_ = 0;
};

}  // namespace candela
