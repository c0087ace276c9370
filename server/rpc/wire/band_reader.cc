#include "server/rpc/wire/band_reader.h"

#include "absl/strings/str_format.h"
#include "proto/candela/v1/band_wire.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

absl::StatusOr<uint32_t> BandReader::count_rows(uint64_t bytes) const {
  if (bytes % stride_bytes_ != 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "band holds %d bytes, which is not a whole number of rows of %d bytes", bytes, stride_bytes_));
  }
  const uint64_t count = bytes / stride_bytes_;
  if (count > desc_.height - rows_) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "band at row %d holds %d rows and the frame has only %d", rows_, count, desc_.height));
  }
  return static_cast<uint32_t>(count);
}

absl::Status BandReader::read(grpc::ByteBuffer& message, Row row) {
  uint32_t count = 0;
  const auto take = [&](google::protobuf::io::CodedInputStream& input, uint64_t bytes) -> absl::Status {
    ASSIGN_OR_RETURN(count, count_rows(bytes));
    const int padding = static_cast<int>(stride_bytes_ - desc_.row_bytes());
    for (uint32_t i = 0; i < count; ++i) {
      const std::span<std::byte> place = row(rows_ + i);
      if (!input.ReadRaw(place.data(), static_cast<int>(place.size())) || !input.Skip(padding)) {
        return absl::InvalidArgumentError("band is truncated");
      }
    }
    return absl::OkStatus();
  };
  ASSIGN_OR_RETURN(const uint32_t first_row, v1::read_band(kind_, message, take));
  if (count == 0) return absl::InvalidArgumentError("band holds no pixels");
  if (first_row != rows_) {
    return absl::InvalidArgumentError(
        absl::StrFormat("band begins at row %d and row %d is next; bands come in order and do not overlap",
                        first_row, rows_));
  }
  rows_ += count;
  CHECK(rows_ <= desc_.height);
  return absl::OkStatus();
}

absl::Status BandReader::check_complete() const {
  if (rows_ == desc_.height) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("call was half-closed after %d of %d rows; send every row first", rows_, desc_.height));
}

}  // namespace candela
