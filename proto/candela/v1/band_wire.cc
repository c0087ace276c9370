#include "proto/candela/v1/band_wire.h"

#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <array>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"

namespace candela::v1 {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;
using google::protobuf::io::CodedOutputStream;

constexpr uint32_t tag(uint32_t field, uint32_t wire_type) { return field << 3 | wire_type; }
constexpr uint32_t field_of(uint32_t tag) { return tag >> 3; }
constexpr uint32_t wire_type_of(uint32_t tag) { return tag & 7; }
constexpr uint32_t kVarint = 0;
constexpr uint32_t kLengthDelimited = 2;

// Band
constexpr uint32_t kFirstRow = tag(1, kVarint);
constexpr uint32_t kPixels = tag(2, kLengthDelimited);
constexpr uint32_t kZstd = tag(3, kLengthDelimited);

absl::Status malformed() {
  return absl::InvalidArgumentError(
      "message is not what render.proto says: its bytes are damaged or cut short");
}

// Reads the length of a length-delimited field and checks that the field ends within its message.
bool read_length(CodedInputStream& input, int& length) {
  return input.ReadVarintSizeAsInt(&length) && length <= input.BytesUntilLimit();
}

// The fields of a band that were read so far.
struct Fields {
  uint32_t first_row = 0;
  uint64_t bytes = 0;  // of its rows
  BandRows form = BandRows::kPixels;
  bool packed = false;  // there was a `zstd` field in the message
};

absl::Status read_fields(CodedInputStream& input, Fields& fields, TakeRows take) {
  while (const uint32_t field = input.ReadTag()) {
    if (field == kFirstRow) {
      if (!input.ReadVarint32(&fields.first_row)) return malformed();
    } else if (field == kPixels || field == kZstd) {
      int length = 0;
      if (!read_length(input, length)) return malformed();
      if (static_cast<uint64_t>(length) > kMaxBandBytes) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "band holds %d bytes and may hold at most %d; send fewer rows in a band", length, kMaxBandBytes));
      }
      const BandRows form = field == kZstd ? BandRows::kZstd : BandRows::kPixels;
      if (fields.bytes > 0 && form != fields.form) {
        if (length == 0) continue;
        return absl::InvalidArgumentError("band holds pixels and zstd; send one of them");
      }
      // A few bytes may be 2 MiB of work.
      if (fields.packed && form == BandRows::kZstd) {
        return absl::InvalidArgumentError("band holds zstd twice; send one of them");
      }
      fields.packed |= form == BandRows::kZstd;
      fields.bytes = static_cast<uint64_t>(length);
      fields.form = form;
      if (absl::Status status = take(input, fields.bytes, form); !status.ok()) return status;
    } else if (!WireFormatLite::SkipField(&input, field)) {
      return malformed();
    }
  }
  return input.ConsumedEntireMessage() ? absl::OkStatus() : malformed();
}

}  // namespace

grpc::ByteBuffer make_band(BandKind kind, uint32_t first_row, grpc::Slice rows, BandRows form) {
  const auto bytes = static_cast<uint32_t>(rows.size());
  size_t band_bytes = 1 + CodedOutputStream::VarintSize32(bytes) + bytes;
  if (first_row != 0) band_bytes += 1 + CodedOutputStream::VarintSize32(first_row);

  std::array<uint8_t, 4 + 3 * 5> head;
  uint8_t* end = CodedOutputStream::WriteTagToArray(tag(kind.field, kLengthDelimited), head.data());
  end = CodedOutputStream::WriteVarint32ToArray(static_cast<uint32_t>(band_bytes), end);
  if (first_row != 0) {
    end = CodedOutputStream::WriteTagToArray(kFirstRow, end);
    end = CodedOutputStream::WriteVarint32ToArray(first_row, end);
  }
  end = CodedOutputStream::WriteTagToArray(form == BandRows::kZstd ? kZstd : kPixels, end);
  end = CodedOutputStream::WriteVarint32ToArray(bytes, end);

  const std::array<grpc::Slice, 2> slices{grpc::Slice(head.data(), static_cast<size_t>(end - head.data())),
                                          std::move(rows)};
  return grpc::ByteBuffer(slices.data(), slices.size());
}

absl::StatusOr<uint32_t> read_band(BandKind kind, grpc::ByteBuffer& message, TakeRows take) {
  grpc::ProtoBufferReader slices(&message);
  CodedInputStream input(&slices);
  input.PushLimit(static_cast<int>(message.Length()));

  // In a oneof the last member counts, and repeated members of the same kind are merged.
  bool is_band = false;
  Fields fields;
  while (const uint32_t field = input.ReadTag()) {
    if (field == tag(kind.field, kLengthDelimited)) {
      if (!is_band) {
        is_band = true;
        fields = {.packed = fields.packed};
        if (absl::Status status = take(input, 0, BandRows::kPixels); !status.ok()) return status;
      }
      int length = 0;
      if (!read_length(input, length)) return malformed();
      const auto outer = input.PushLimit(length);
      if (absl::Status status = read_fields(input, fields, take); !status.ok()) return status;
      input.PopLimit(outer);
      continue;
    }
    const bool member = field_of(field) >= 1 && field_of(field) <= kind.members;
    if (member && wire_type_of(field) == kLengthDelimited) is_band = false;
    if (!WireFormatLite::SkipField(&input, field)) return malformed();
  }
  if (!input.ConsumedEntireMessage()) return malformed();
  if (!is_band) return absl::InvalidArgumentError("message holds no band, but a band is due");
  return fields.first_row;
}

}  // namespace candela::v1
