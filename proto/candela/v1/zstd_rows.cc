#include "proto/candela/v1/zstd_rows.h"

#include <cstring>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/check.h"

namespace candela::v1 {
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

}  // namespace candela::v1
