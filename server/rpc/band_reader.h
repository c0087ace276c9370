// Requests from bytes: messages, and bands whose rows are copied into place.
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "proto/candela/v1/band_wire.h"
#include "server/base/clock.h"
#include "server/session/render_start.h"

namespace candela {

// Parsing of the messages of a call that hold no pixels.

// Parses `message`, which holds no band, into `request`. INVALID_ARGUMENT if it is too long for such a
// message, or damaged.
absl::Status parse_request(grpc::ByteBuffer& message, google::protobuf::Message& request);

// A reader of the bands of one frame.
//
// Not thread-safe.
class BandReader {
 public:
  // Returns where a row goes: layout.desc.row_bytes() bytes.
  using Row = absl::FunctionRef<std::span<std::byte>(uint32_t y)>;

  // Called with the time that a band took to decompress.
  using Charge = std::function<void(absl::Duration)>;

  // `layout` is the frame's, from wire_layout_from(). `clock` outlives the reader.
  BandReader(v1::BandKind kind, const WireLayout& layout, Clock& clock, Charge charge = nullptr)
      : kind_(kind), layout_(layout), clock_(clock), charge_(std::move(charge)) {}

  // Brings the band's rows to their places: without the bytes between them, with an alpha, and decompressed.
  // INVALID_ARGUMENT if the band does not hold whole rows, does not begin where the last one ended, exceeds
  // the frame or is damaged. Takes no memory for rows that the frame does not have.
  absl::Status read(grpc::ByteBuffer& message, Row row);
  // Checks a band in the same way, but drops its rows and does not decompress them.
  absl::Status pass(grpc::ByteBuffer& message);

  bool complete() const { return rows_ == layout_.desc.height; }
  // OK if every row has arrived, else INVALID_ARGUMENT with the number of rows.
  absl::Status check_complete() const;

 private:
  using Input = google::protobuf::io::CodedInputStream;

  // The number of rows in `bytes` bytes.
  absl::StatusOr<uint32_t> count_rows(uint64_t bytes, uint64_t bytes_each) const;
  // `row` may be null.
  absl::Status read_rows(grpc::ByteBuffer& message, const Row* row);
  // `fill` puts row i of the band, as it is on the wire, into a span of its size, or returns false.
  absl::Status place_rows(uint32_t count, Row row,
                          absl::FunctionRef<bool(uint32_t i, std::span<std::byte> wire)> fill) const;
  absl::StatusOr<uint32_t> copy(Input& input, uint64_t bytes, const Row* row) const;
  absl::StatusOr<uint32_t> unpack(Input& input, uint64_t bytes, const Row* row) const;

  const v1::BandKind kind_;
  const WireLayout layout_;
  Clock& clock_;
  const Charge charge_;
  uint32_t rows_ = 0;
};

}  // namespace candela
