#include "proto/candela/v1/band_wire.h"

#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/check.h"

namespace candela::v1 {
namespace {

constexpr uint16_t kHalfOne = 0x3c00;
constexpr uint32_t kFloatOne = 0x3f800000;

template <typename Component>
void add(Component one, std::span<const std::byte> row, std::span<std::byte> place) {
  constexpr size_t kRgb = 3 * sizeof(Component), kRgba = 4 * sizeof(Component);
  const size_t width = row.size() / kRgb;
  CHECK(place.size() == width * kRgba);
  for (size_t x = 0; x < width; ++x) {
    std::memcpy(place.data() + x * kRgba, row.data() + x * kRgb, kRgb);
    std::memcpy(place.data() + x * kRgba + kRgb, &one, sizeof(one));
  }
}

template <typename Component>
void leave_out(std::span<const std::byte> row, std::span<std::byte> place) {
  constexpr size_t kRgb = 3 * sizeof(Component), kRgba = 4 * sizeof(Component);
  const size_t width = row.size() / kRgba;
  CHECK(place.size() == width * kRgb);
  for (size_t x = 0; x < width; ++x) std::memcpy(place.data() + x * kRgb, row.data() + x * kRgba, kRgb);
}

}  // namespace

void add_alpha(PixelFormat format, std::span<const std::byte> row, std::span<std::byte> place) {
  CHECK(format == PIXEL_FORMAT_RGB16F || format == PIXEL_FORMAT_RGB32F);
  if (format == PIXEL_FORMAT_RGB16F) return add(kHalfOne, row, place);
  add(kFloatOne, row, place);
}

void add_alpha(OutputFormat format, std::span<const std::byte> row, std::span<std::byte> place) {
  if (format == OUTPUT_FORMAT_RGBA8) return add<uint8_t>(UINT8_MAX, row, place);
  add(format == OUTPUT_FORMAT_RGBA16F ? kHalfOne : uint16_t{UINT16_MAX}, row, place);
}

void leave_out_alpha(OutputFormat format, std::span<const std::byte> row, std::span<std::byte> place) {
  if (format == OUTPUT_FORMAT_RGBA8) return leave_out<uint8_t>(row, place);
  leave_out<uint16_t>(row, place);
}

namespace {

// zstd's own fastest: 500 to 900 MB/s on a core, where a link of 2.5 Gbit/s takes 300.
constexpr int kLevel = 1;

// A pixel is `components` words of type Word.
template <typename Word_, size_t components_>
struct Form {
  using Word = Word_;
  static constexpr size_t components = components_;
  static constexpr size_t bytes = sizeof(Word) * components;
};

// Calls `use` with the form of a format.
template <typename Use>
void with_form(PixelFormat format, Use use) {
  switch (format) {
    case PIXEL_FORMAT_RGBA16F:
      return use(Form<uint16_t, 4>{});
    case PIXEL_FORMAT_RGBA32F:
      return use(Form<uint32_t, 4>{});
    case PIXEL_FORMAT_RGB9E5:
      return use(Form<uint32_t, 1>{});
    case PIXEL_FORMAT_RGB16F:
      return use(Form<uint16_t, 3>{});
    case PIXEL_FORMAT_RGB32F:
      return use(Form<uint32_t, 3>{});
    default:
      CHECK(false);
  }
}

// The sign goes into the lowest bit, so small numbers of both signs have empty high bytes.
template <typename Word>
Word fold(Word difference) {
  const auto sign = static_cast<Word>(0 - (difference >> (8 * sizeof(Word) - 1)));
  return static_cast<Word>(static_cast<Word>(difference << 1) ^ sign);
}
template <typename Word>
Word unfold(Word folded) {
  return static_cast<Word>((folded >> 1) ^ static_cast<Word>(0 - (folded & 1)));
}

template <typename Word>
Word load(const std::byte* from) {
  Word word;
  std::memcpy(&word, from, sizeof(Word));
  return word;
}

// `planes` points at the row's place in the first of them; `count` bytes further is that in the next one.
// Byte b of component c is in plane b * components + c.
template <typename F>
void split(F, const std::byte* row, uint32_t width, std::byte* planes, size_t count) {
  using Word = typename F::Word;
  for (size_t c = 0; c < F::components; ++c) {
    Word before = 0;
    for (uint32_t x = 0; x < width; ++x) {
      const Word word = load<Word>(row + x * F::bytes + c * sizeof(Word));
      const Word folded = fold(static_cast<Word>(word - before));
      before = word;
      for (size_t b = 0; b < sizeof(Word); ++b) {
        planes[(b * F::components + c) * count + x] = static_cast<std::byte>(folded >> (8 * b));
      }
    }
  }
}

template <typename F>
void join(F, const std::byte* planes, size_t count, uint32_t width, std::byte* place) {
  using Word = typename F::Word;
  for (size_t c = 0; c < F::components; ++c) {
    Word word = 0;
    for (uint32_t x = 0; x < width; ++x) {
      Word folded = 0;
      for (size_t b = 0; b < sizeof(Word); ++b) {
        folded = static_cast<Word>(folded | static_cast<Word>(planes[(b * F::components + c) * count + x])
                                                << (8 * b));
      }
      word = static_cast<Word>(word + unfold(folded));
      std::memcpy(place + x * F::bytes + c * sizeof(Word), &word, sizeof(Word));
    }
  }
}

}  // namespace

grpc::Slice RowPacker::pack(std::span<const std::byte> rows, uint32_t width, PixelFormat format) {
  CHECK(!rows.empty() && rows.size() <= kMaxBandBytes);
  planes_.resize(rows.size());
  with_form(format, [&](auto form) {
    const size_t count = rows.size() / form.bytes;
    for (size_t at = 0; at < count; at += width) {
      split(form, rows.data() + at * form.bytes, width, planes_.data() + at, count);
    }
  });
  packed_.resize(ZSTD_compressBound(planes_.size()));
  const size_t size = ZSTD_compressCCtx(context_.get(), packed_.data(), packed_.size(), planes_.data(),
                                        planes_.size(), kLevel);
  CHECK(!ZSTD_isError(size));
  return grpc::Slice(packed_.data(), size);
}

absl::StatusOr<uint64_t> RowUnpacker::unpacked_bytes(std::span<const std::byte> packed) {
  // zstd's library may know older forms and takes several frames, each of which would be work.
  uint32_t magic = 0;
  if (packed.size() >= sizeof(magic)) std::memcpy(&magic, packed.data(), sizeof(magic));
  if (magic != ZSTD_MAGICNUMBER ||
      ZSTD_findFrameCompressedSize(packed.data(), packed.size()) != packed.size()) {
    return absl::InvalidArgumentError("band.zstd is not one whole frame of zstd");
  }
  const uint64_t bytes = ZSTD_getFrameContentSize(packed.data(), packed.size());
  if (bytes == ZSTD_CONTENTSIZE_ERROR) return absl::InvalidArgumentError("band.zstd is damaged");
  if (bytes == ZSTD_CONTENTSIZE_UNKNOWN) {
    return absl::InvalidArgumentError("band.zstd does not say its size; compress each band whole");
  }
  if (bytes <= kMaxBandBytes) return bytes;
  return absl::InvalidArgumentError(absl::StrFormat(
      "band.zstd says that it holds %d bytes and may hold at most %d; send fewer rows in a band", bytes,
      kMaxBandBytes));
}

absl::Status RowUnpacker::begin(std::span<const std::byte> packed, uint64_t bytes, uint32_t width,
                                PixelFormat format) {
  width_ = width;
  format_ = format;
  if (context_ == nullptr)
    return absl::ResourceExhaustedError("the server lacks the memory to decompress a band");
  planes_.resize(bytes);
  // One pass into memory of the stated size: zstd takes no window of its own, and refuses what is longer.
  const size_t size =
      ZSTD_decompressDCtx(context_.get(), planes_.data(), planes_.size(), packed.data(), packed.size());
  if (!ZSTD_isError(size) && size == planes_.size()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "band.zstd is damaged: %s", ZSTD_isError(size) ? ZSTD_getErrorName(size) : "it is too short"));
}

void RowUnpacker::read(uint32_t y, std::span<std::byte> place) const {
  with_form(format_, [&](auto form) {
    const size_t count = planes_.size() / form.bytes;
    const size_t at = size_t{y} * width_;
    CHECK(at + width_ <= count && place.size() == width_ * form.bytes);
    join(form, planes_.data() + at, count, width_, place.data());
  });
}

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
