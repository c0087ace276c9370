// The rows of one frame as its bands arrive.
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

// One thread at a time.
class BandReader {
 public:
  // Gives the place of a row: desc.row_bytes() bytes.
  using Row = absl::FunctionRef<std::span<std::byte>(uint32_t y)>;

  // `kind` of band; `desc` has passed check_frame; rows come `row_stride_bytes` apart, what is past the tight
  // row is dropped.
  BandReader(v1::BandKind kind, const FrameDesc& desc, uint64_t row_stride_bytes)
      : kind_(kind), desc_(desc), stride_bytes_(row_stride_bytes) {}

  // Copies the band's rows to their places. INVALID_ARGUMENT for one that is not whole rows, does not begin
  // where the last one ended, or goes past the frame.
  absl::Status read(grpc::ByteBuffer& message, Row row);

  bool complete() const { return rows_ == desc_.height; }
  // OK when every row is there, else INVALID_ARGUMENT with how many are.
  absl::Status check_complete() const;

 private:
  absl::StatusOr<uint32_t> count_rows(uint64_t bytes) const;

  const v1::BandKind kind_;
  const FrameDesc desc_;
  const uint64_t stride_bytes_;
  uint32_t rows_ = 0;
};

}  // namespace candela
