// Bands without the generated classes, which would hold every pixel twice: the bytes on the wire are exactly
// those of render.proto. Serves RenderRequest and RenderResponse alike, whose `band` is field 2 of both.
#pragma once

#include <google/protobuf/io/coded_stream.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/slice.h>

#include <cstdint>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"

namespace candela::v1 {

// A message that holds the band whose first row is `first_row`. `pixels` is referred to, not copied, and is
// not empty.
grpc::ByteBuffer make_band(uint32_t first_row, grpc::Slice pixels);

// Takes the `bytes` (0 .. kMaxBandBytes) pixel bytes that come next from `input`, all of them, or fails.
// Called with 0 first and then for each `pixels` field: as in protobuf the last one counts, so each call
// starts anew.
using TakePixels =
    absl::FunctionRef<absl::Status(google::protobuf::io::CodedInputStream& input, uint64_t bytes)>;

// Reads a message that holds a band and gives its first row. INVALID_ARGUMENT for bytes that are not such a
// message and for a band over kMaxBandBytes; else what `take` failed with. Unknown fields are skipped.
absl::StatusOr<uint32_t> read_band(grpc::ByteBuffer& message, TakePixels take);

}  // namespace candela::v1
