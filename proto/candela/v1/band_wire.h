// Bands as bytes: rows of pixels with and without alpha, compressed or not, and their messages.
#pragma once

#include <google/protobuf/io/coded_stream.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/slice.h>
#include <zstd.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"

namespace candela::v1 {

// Rows of pixels with and without alpha.

// Copies a tight row without alpha to `place`, which holds as many pixels with an alpha of 1. The format is
// RGB16F or RGB32F.
void add_alpha(PixelFormat format, std::span<const std::byte> row, std::span<std::byte> place);
// The same for an image, of any format.
void add_alpha(OutputFormat format, std::span<const std::byte> row, std::span<std::byte> place);

// Copies a tight row of an image to `place`, which holds as many pixels of R, G and B.
void leave_out_alpha(OutputFormat format, std::span<const std::byte> row, std::span<std::byte> place);

// Rows of pixels as Band.zstd holds them: the same bits in fewer bytes. docs/transport.md defines the form.

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

// Reads and writes band messages without the generated classes, which would copy every pixel. The bytes on
// the wire are exactly those of render.proto.

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
