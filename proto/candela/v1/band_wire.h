// Bands without the generated classes, which would hold every pixel twice: the bytes on the wire are exactly
// those of render.proto.
#pragma once

#include <google/protobuf/io/coded_stream.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/slice.h>

#include <cstdint>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"

namespace candela::v1 {

// Which band of which message: the member of its oneof, and how many members that has (fields 1, 2, ...).
struct BandKind {
  uint32_t field;
  uint32_t members;
};
inline constexpr BandKind kFrameBand{2, 2};        // RenderRequest.band
inline constexpr BandKind kImageBand{2, 3};        // RenderResponse.band
inline constexpr BandKind kErrorMapBand{3, 3};     // RenderResponse.error_map
inline constexpr BandKind kStreamFrameBand{2, 4};  // StreamRequest.band
inline constexpr BandKind kStreamImageBand{2, 6};  // StreamResponse.band

// A message that holds the band whose first row is `first_row`. `pixels` is referred to, not copied, and is
// not empty.
grpc::ByteBuffer make_band(BandKind kind, uint32_t first_row, grpc::Slice pixels);

// Takes the `bytes` (0 .. kMaxBandBytes) pixel bytes that come next from `input`, all of them, or fails.
// Called with 0 first and then for each `pixels` field: as in protobuf the last one counts, so each call
// starts anew.
using TakePixels =
    absl::FunctionRef<absl::Status(google::protobuf::io::CodedInputStream& input, uint64_t bytes)>;

// Reads a message that holds such a band and gives its first row. INVALID_ARGUMENT for bytes that are not
// such a message and for a band over kMaxBandBytes; else what `take` failed with. Unknown fields are skipped.
absl::StatusOr<uint32_t> read_band(BandKind kind, grpc::ByteBuffer& message, TakePixels take);

}  // namespace candela::v1
