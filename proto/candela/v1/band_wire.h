// Reads and writes band messages without the generated classes, which would copy every pixel. The bytes on
// the wire are exactly those of render.proto.
#pragma once

#include <google/protobuf/io/coded_stream.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/slice.h>

#include <cstdint>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"

namespace candela::v1 {

// A band's place in its message: its field, and the number of members of the oneof (fields 1, 2, ...).
struct BandKind {
  uint32_t field;
  uint32_t members;
};
inline constexpr BandKind kFrameBand{2, 2};        // RenderRequest.band
inline constexpr BandKind kImageBand{2, 3};        // RenderResponse.band
inline constexpr BandKind kErrorMapBand{3, 3};     // RenderResponse.error_map
inline constexpr BandKind kStreamFrameBand{2, 4};  // StreamRequest.band
inline constexpr BandKind kStreamImageBand{2, 6};  // StreamResponse.band
inline constexpr BandKind kPanoramaBand{2, 2};     // PutEnvironmentRequest.band
inline constexpr BandKind kBakeBand{3, 3};         // BakeEnvironmentResponse.band

// The form of a band's rows.
enum class BandRows { kPixels, kZstd };

// Makes a message with one band that begins at row `first_row`. `rows` is not empty and is not copied; the
// message keeps a reference to it.
grpc::ByteBuffer make_band(BandKind kind, uint32_t first_row, grpc::Slice rows,
                           BandRows form = BandRows::kPixels);

// Reads the next `bytes` (0 .. kMaxBandBytes) bytes of rows from `input`, all of them, or fails. It is called
// with 0 pixels first and then for each `pixels` or `zstd` field. Each call starts over, because in protobuf
// the last field counts.
using TakeRows = absl::FunctionRef<absl::Status(google::protobuf::io::CodedInputStream& input, uint64_t bytes,
                                                BandRows form)>;

// Reads a message with such a band and returns its first row. INVALID_ARGUMENT if the bytes are not such a
// message or if the band is larger than kMaxBandBytes; otherwise fails as `take` does. Skips unknown fields.
absl::StatusOr<uint32_t> read_band(BandKind kind, grpc::ByteBuffer& message, TakeRows take);

}  // namespace candela::v1
