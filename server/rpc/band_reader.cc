#include "server/rpc/band_reader.h"

#include <vector>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Room for the largest colour table and for every other field at its longest value.
constexpr size_t kMaxRequestBytes = v1::kMaxTableBytes + (64 << 10);

}  // namespace

absl::Status parse_request(grpc::ByteBuffer& message, google::protobuf::Message& request) {
  if (message.Length() > kMaxRequestBytes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "message has %d bytes; a message without a band has at most %d, so send the start of the call or "
        "frame first and its bands after it",
        message.Length(), kMaxRequestBytes));
  }
  if (!v1::unpack(message, request)) {
    return absl::InvalidArgumentError(
        "message does not match render.proto: its bytes are damaged or truncated");
  }
  return absl::OkStatus();
}

namespace {

absl::Status truncated() { return absl::InvalidArgumentError("band is truncated"); }

}  // namespace

absl::StatusOr<uint32_t> BandReader::count_rows(uint64_t bytes, uint64_t bytes_each) const {
  if (bytes % bytes_each != 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "band holds %d bytes, which is not a whole number of rows of %d bytes", bytes, bytes_each));
  }
  const uint64_t count = bytes / bytes_each;
  if (count > layout_.desc.height - rows_) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "band at row %d holds %d rows and the frame has only %d", rows_, count, layout_.desc.height));
  }
  return static_cast<uint32_t>(count);
}

absl::Status BandReader::place_rows(
    uint32_t count, Row row, absl::FunctionRef<bool(uint32_t i, std::span<std::byte> wire)> fill) const {
  const bool add_alpha = layout_.format != layout_.desc.format;
  std::vector<std::byte> narrow(add_alpha && count > 0 ? layout_.row_bytes() : 0);
  for (uint32_t i = 0; i < count; ++i) {
    const std::span<std::byte> place = row(rows_ + i);
    if (!fill(i, add_alpha ? std::span(narrow) : place)) return truncated();
    if (add_alpha) v1::add_alpha(layout_.format, narrow, place);
  }
  return absl::OkStatus();
}

absl::StatusOr<uint32_t> BandReader::copy(Input& input, uint64_t bytes, const Row* row) const {
  ASSIGN_OR_RETURN(const uint32_t count, count_rows(bytes, layout_.row_stride_bytes));
  if (row == nullptr) {
    if (!input.Skip(static_cast<int>(bytes))) return truncated();
    return count;
  }
  const auto padding = static_cast<int>(layout_.row_stride_bytes - layout_.row_bytes());
  RETURN_IF_ERROR(place_rows(count, *row, [&](uint32_t, std::span<std::byte> wire) {
    return input.ReadRaw(wire.data(), static_cast<int>(wire.size())) && input.Skip(padding);
  }));
  return count;
}

absl::StatusOr<uint32_t> BandReader::unpack(Input& input, uint64_t bytes, const Row* row) const {
  // A few megabytes for each thread that reads.
  thread_local std::vector<std::byte> packed;
  thread_local v1::RowUnpacker unpacker;
  packed.resize(bytes);
  if (!input.ReadRaw(packed.data(), static_cast<int>(bytes))) return truncated();
  ASSIGN_OR_RETURN(const uint64_t unpacked, v1::RowUnpacker::unpacked_bytes(packed));
  ASSIGN_OR_RETURN(const uint32_t count, count_rows(unpacked, layout_.row_bytes()));
  if (row == nullptr) return count;
  const auto begin = clock_.steady();
  RETURN_IF_ERROR(unpacker.begin(packed, unpacked, layout_.desc.width, layout_.format));
  RETURN_IF_ERROR(place_rows(count, *row, [&](uint32_t i, std::span<std::byte> wire) {
    unpacker.read(i, wire);
    return true;
  }));
  if (charge_) charge_(absl::FromChrono(clock_.steady() - begin));
  return count;
}

absl::Status BandReader::read(grpc::ByteBuffer& message, Row row) { return read_rows(message, &row); }

absl::Status BandReader::pass(grpc::ByteBuffer& message) { return read_rows(message, nullptr); }

absl::Status BandReader::read_rows(grpc::ByteBuffer& message, const Row* row) {
  uint32_t count = 0;
  const auto take = [&](Input& input, uint64_t bytes, v1::BandRows form) -> absl::Status {
    ASSIGN_OR_RETURN(count,
                     form == v1::BandRows::kZstd ? unpack(input, bytes, row) : copy(input, bytes, row));
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
  CHECK(rows_ <= layout_.desc.height);
  return absl::OkStatus();
}

absl::Status BandReader::check_complete() const {
  if (complete()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "call was half-closed after %d of %d rows; send every row first", rows_, layout_.desc.height));
}

}  // namespace candela
