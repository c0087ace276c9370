// Encodes PNG: rows, their filters (PNG, chapter 9), deflate and chunks. Highway chooses the instruction set
// of the rows at run time; the results do not depend on it.

// What has none of these runs Highway's plain code.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/encode/png.cc"
#include <hwy/foreach_target.h>
// Only after foreach_target.h.
#include <hwy/highway.h>
#include <isa-l/crc.h>
#include <isa-l/igzip_lib.h>
#include <png.h>
#include <zlib.h>

#include <algorithm>
#include <atomic>
#include <csetjmp>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <deque>
#include <memory>
#include <new>
#include <span>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "server/base/crew.h"
#include "server/base/process.h"
#include "server/encode/color_words.h"
#include "server/encode/picture.h"

#ifndef CANDELA_PNG_MARGIN
#define CANDELA_PNG_MARGIN
namespace candela {

// A row of a PNG lies between this many bytes of memory on either side, because vectors reach beyond it.
constexpr size_t kPngMargin = 64;

}  // namespace candela
#endif

HWY_BEFORE_NAMESPACE();
namespace candela::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Bytes = hn::ScalableTag<uint8_t>;
using Byte = hn::Vec<Bytes>;
constexpr Bytes kBytes;
constexpr hn::RebindToSigned<Bytes> kSigned;
constexpr hn::Repartition<uint64_t, Bytes> kSums;
using Sum = hn::Vec<hn::Repartition<uint64_t, Bytes>>;
static_assert(hn::MaxLanes(kBytes) <= kPngMargin);

enum Filter : uint8_t { kSub = 1, kUp = 2, kAverage = 3, kPaeth = 4 };

HWY_INLINE Byte difference(Byte a, Byte b) { return hn::Max(hn::SaturatedSub(a, b), hn::SaturatedSub(b, a)); }

// The one of left, up and corner that is nearest to left + up - corner; the first of those if several are.
// The distances are a = |up - corner|, b = |left - corner| and c, which is a + b where up and left lie on the
// same side of the corner, else |a - b|. A sum beyond 255 is as far as 255: a or b is less than it.
HWY_INLINE Byte paeth(Byte left, Byte up, Byte corner) {
  const Byte a = difference(up, corner);
  const Byte b = difference(left, corner);
  const auto up_above = hn::Eq(hn::Max(up, corner), up);
  const auto left_above = hn::Eq(hn::Max(left, corner), left);
  const Byte c = hn::IfThenElse(hn::Xor(up_above, left_above), difference(a, b), hn::SaturatedAdd(a, b));
  const Byte least = hn::Min(hn::Min(a, b), c);
  return hn::IfThenElse(hn::Eq(a, least), left, hn::IfThenElse(hn::Eq(b, least), up, corner));
}

template <Filter kFilter>
HWY_INLINE Byte predict(Byte left, Byte up, Byte corner) {
  if constexpr (kFilter == kSub) return left;
  if constexpr (kFilter == kUp) return up;
  // AverageRound rounds up, but PNG rounds down.
  if constexpr (kFilter == kAverage) {
    return hn::Sub(hn::AverageRound(left, up), hn::And(hn::Xor(left, up), hn::Set(kBytes, 1)));
  }
  return paeth(left, up, corner);
}

struct Neighbours {
  Byte here, left, up, corner;
};

HWY_INLINE Neighbours load(const uint8_t* row, const uint8_t* above, size_t pixel_bytes) {
  return {hn::LoadU(kBytes, row), hn::LoadU(kBytes, row - pixel_bytes), hn::LoadU(kBytes, above),
          hn::LoadU(kBytes, above - pixel_bytes)};
}

template <Filter kFilter>
HWY_INLINE Byte filtered(const Neighbours& at) {
  return hn::Sub(at.here, predict<kFilter>(at.left, at.up, at.corner));
}

template <Filter kFilter, typename Mask>
HWY_INLINE void add_magnitudes(const Neighbours& at, Mask inside, Sum& sum) {
  const Byte magnitudes = hn::BitCast(kBytes, hn::Abs(hn::BitCast(kSigned, filtered<kFilter>(at))));
  sum = hn::Add(sum, hn::SumsOf8(hn::IfThenElseZero(inside, magnitudes)));
}

Filter best_filter(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes) {
  Sum sub = hn::Zero(kSums), up = sub, average = sub, paeths = sub;
  for (size_t i = 0; i < bytes; i += hn::Lanes(kBytes)) {
    const Neighbours at = load(row + i, above + i, pixel_bytes);
    const auto inside = hn::FirstN(kBytes, std::min(bytes - i, hn::Lanes(kBytes)));
    add_magnitudes<kSub>(at, inside, sub);
    add_magnitudes<kUp>(at, inside, up);
    add_magnitudes<kAverage>(at, inside, average);
    add_magnitudes<kPaeth>(at, inside, paeths);
  }
  uint64_t sums[4];
  sums[0] = hn::GetLane(hn::SumOfLanes(kSums, sub));
  sums[1] = hn::GetLane(hn::SumOfLanes(kSums, up));
  sums[2] = hn::GetLane(hn::SumOfLanes(kSums, average));
  sums[3] = hn::GetLane(hn::SumOfLanes(kSums, paeths));
  return static_cast<Filter>(kSub + (std::min_element(sums, sums + 4) - sums));
}

template <Filter kFilter>
void write_row(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes, uint8_t* out) {
  out[0] = kFilter;
  for (size_t i = 0; i < bytes; i += hn::Lanes(kBytes)) {
    hn::StoreU(filtered<kFilter>(load(row + i, above + i, pixel_bytes)), kBytes, out + 1 + i);
  }
}

void filter_row(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes, uint8_t* out) {
  switch (best_filter(row, above, bytes, pixel_bytes)) {
    case kSub:
      return write_row<kSub>(row, above, bytes, pixel_bytes, out);
    case kUp:
      return write_row<kUp>(row, above, bytes, pixel_bytes, out);
    case kAverage:
      return write_row<kAverage>(row, above, bytes, pixel_bytes, out);
    case kPaeth:
      return write_row<kPaeth>(row, above, bytes, pixel_bytes, out);
  }
}

template <typename V>
HWY_INLINE V high_byte_first(V v) {
  if constexpr (sizeof(hn::TFromV<V>) == 1) return v;
  if constexpr (sizeof(hn::TFromV<V>) == 2) return hn::Or(hn::ShiftLeft<8>(v), hn::ShiftRight<8>(v));
}

// Returns how many pixels are packed. What is left is less than a vector.
template <typename Component>
uint32_t pack_vectors(const Component* rgba, uint32_t pixels, bool alpha, Component* row) {
  const hn::ScalableTag<Component> d;
  const auto lanes = static_cast<uint32_t>(hn::Lanes(d));
  uint32_t x = 0;
  for (; pixels - x >= lanes; x += lanes) {
    hn::Vec<decltype(d)> r, g, b, a;
    hn::LoadInterleaved4(d, rgba + size_t{4} * x, r, g, b, a);
    r = high_byte_first(r), g = high_byte_first(g), b = high_byte_first(b), a = high_byte_first(a);
    if (alpha) hn::StoreInterleaved4(r, g, b, a, d, row + size_t{4} * x);
    if (!alpha) hn::StoreInterleaved3(r, g, b, d, row + size_t{3} * x);
  }
  return x;
}

void pack_row(const std::byte* rgba, uint32_t pixels, bool wide, bool alpha, uint8_t* row) {
  const size_t kept = alpha ? 4 : 3;
  if (!wide && alpha) {
    std::memcpy(row, rgba, kept * pixels);
  } else if (!wide) {
    const auto* from = reinterpret_cast<const uint8_t*>(rgba);
    for (size_t x = pack_vectors(from, pixels, alpha, row); x < pixels; ++x) {
      std::memcpy(row + kept * x, from + 4 * x, kept);
    }
  } else {
    const auto* from = reinterpret_cast<const uint16_t*>(rgba);
    for (size_t x = pack_vectors(from, pixels, alpha, reinterpret_cast<uint16_t*>(row)); x < pixels; ++x) {
      for (size_t c = 0; c < kept; ++c) {
        row[2 * (kept * x + c)] = static_cast<uint8_t>(from[4 * x + c] >> 8);
        row[2 * (kept * x + c) + 1] = static_cast<uint8_t>(from[4 * x + c]);
      }
    }
  }
}

}  // namespace

void filter_row_here(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes,
                     uint8_t* out) {
  filter_row(row, above, bytes, pixel_bytes, out);
}

void pack_row_here(const std::byte* rgba, uint32_t pixels, bool wide, bool alpha, uint8_t* row) {
  pack_row(rgba, pixels, wide, alpha, row);
}

}  // namespace candela::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace candela {
namespace {

HWY_EXPORT(filter_row_here);
HWY_EXPORT(pack_row_here);

// Filters a row by whichever of Sub, Up, Average and Paeth leaves the least sum of magnitudes; the first of
// those if several do. Writes the filter's number and `bytes` bytes to `out`, and anything to the margin
// after them. `above` is the packed row above, or zeros. The margins before `row` and `above` are zeros.
void filter_png_row(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes,
                    uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(filter_row_here)(row, above, bytes, pixel_bytes, out);
}

// Packs pixels of RGBA, 16 bits per component in the machine's byte order if `wide`, else 8, into a row of a
// PNG: without the fourth component unless `alpha`, 16 bits with the high byte first.
void pack_png_row(const std::byte* rgba, uint32_t pixels, bool wide, bool alpha, uint8_t* row) {
  HWY_DYNAMIC_DISPATCH(pack_row_here)(rgba, pixels, wide, alpha, row);
}

// Why the sink did not take the bytes; null if it did.
const char* send_to(ByteSink sink, const void* bytes, size_t count);

// Bytes of filtered rows. A stripe begins with Huffman codes of its own, about 140 bytes. A band is filtered
// and deflated while it is in the level-2 cache.
constexpr size_t kStripeBytes = 512 << 10;
constexpr size_t kBandBytes = 128 << 10;

// How a picture is cut into stripes, and these into bands. The number of threads must not change it, because
// it decides the bytes.
struct Cut {
  Cut(const PictureView& view, bool with_alpha)
      : picture(view),
        alpha(with_alpha),
        pixel_bytes((alpha ? size_t{4} : size_t{3}) * (picture.wide ? 2 : 1)),
        row_bytes(pixel_bytes * picture.width),
        band_rows(rows_in(kBandBytes)),
        stripe_rows(rows_in(kStripeBytes)),
        stripes((picture.height - 1) / stripe_rows + 1) {}

  uint32_t rows_in(size_t filtered_bytes) const {
    return static_cast<uint32_t>(std::clamp<size_t>(filtered_bytes / (row_bytes + 1), 1, picture.height));
  }

  const PictureView picture;
  const bool alpha;
  const size_t pixel_bytes;
  const size_t row_bytes;
  const uint32_t band_rows;
  const uint32_t stripe_rows;
  const uint32_t stripes;
};

std::unique_ptr<uint8_t[]> memory_of(size_t bytes) {
  return std::make_unique_for_overwrite<uint8_t[]>(bytes);
}

uint8_t* put_big_endian(uint32_t value, uint8_t* at) {
  for (int shift = 24; shift >= 0; shift -= 8) *at++ = static_cast<uint8_t>(value >> shift);
  return at;
}

// Makes IDAT chunks, each of one stripe. What it makes of a stripe does not depend on those before.
class ChunkMaker {
 public:
  explicit ChunkMaker(const Cut& cut)
      : cut_(cut),
        line_bytes_(cut.row_bytes + 2 * kPngMargin),
        deflated_capacity_(deflated_at_most(cut.stripe_rows * (cut.row_bytes + 1))),
        lines_(std::make_unique<uint8_t[]>(2 * line_bytes_)),
        band_(memory_of(cut.band_rows * (cut.row_bytes + 1) + kPngMargin)),
        level_(memory_of(ISAL_DEF_LVL1_DEFAULT)),
        chunk_(memory_of(kBefore + deflated_capacity_ + kAfter)),
        stream_(std::make_unique_for_overwrite<isal_zstream>()) {}

  // False if isa-l fails.
  bool make(uint32_t stripe) {
    const uint32_t begin = stripe * cut_.stripe_rows;
    const uint32_t end = std::min(begin + cut_.stripe_rows, cut_.picture.height);
    start(stripe == 0);
    if (begin == 0) std::memset(above_, 0, cut_.row_bytes);
    if (begin > 0) pack(begin - 1, above_);
    for (uint32_t y = begin; y < end; y += cut_.band_rows) {
      const uint32_t band_end = std::min(y + cut_.band_rows, end);
      const size_t bytes = filter(y, band_end);
      adler_ = isal_adler32(adler_, band_.get(), bytes);
      filtered_bytes_ += bytes;
      if (!deflate(bytes, y == begin, band_end == end, end == cut_.picture.height)) return false;
    }
    end_ = stream_->next_out;
    return true;
  }

  // The checksum of the rows so far, with those of this chunk.
  uint32_t adler_after(uint32_t adler_before) const {
    return static_cast<uint32_t>(
        adler32_combine(adler_before, adler_, static_cast<z_off_t>(filtered_bytes_)));
  }

  // The whole chunk. The stream's last one ends with the checksum of all rows.
  std::pair<const uint8_t*, size_t> finish(const uint32_t* adler_of_all) {
    if (adler_of_all != nullptr) end_ = put_big_endian(*adler_of_all, end_);
    const auto kind_and_data = static_cast<uint64_t>(end_ - kind());
    put_big_endian(static_cast<uint32_t>(kind_and_data - 4), chunk_.get());
    end_ = put_big_endian(crc32_gzip_refl(0, kind(), kind_and_data), end_);
    return {chunk_.get(), static_cast<size_t>(end_ - chunk_.get())};
  }

 private:
  static constexpr size_t kBefore = 4 + 4 + 2;  // length, kind, the stream's first bytes
  static constexpr size_t kAfter = 4 + 4;       // the stream's checksum, the chunk's
  // A stripe's first bytes are deflated alone, by isa-l's code for short inputs. That for long ones hashes a
  // register that it never set (rcx, in 2.30's write_first_byte): the stream's address would decide which
  // runs it finds, in one stripe of some thousand.
  static constexpr size_t kAlone = 8;

  uint8_t* kind() { return chunk_.get() + 4; }

  // More than zlib needs: it stores a block that its codes would make longer, and adds some bytes to it.
  static size_t deflated_at_most(size_t bytes) { return bytes + bytes / 8 + 4096; }

  void start(bool first_of_picture) {
    filtered_bytes_ = 0;
    adler_ = 1;
    end_ = kind();
    for (const char c : {'I', 'D', 'A', 'T'}) *end_++ = static_cast<uint8_t>(c);
    if (first_of_picture) {
      // zlib's header: deflate, a window of 32 KB, no dictionary, the fastest level.
      *end_++ = 0x78;
      *end_++ = 0x01;
    }
    isal_deflate_init(stream_.get());
    stream_->level = 1;
    stream_->level_buf = level_.get();
    stream_->level_buf_size = ISAL_DEF_LVL1_DEFAULT;
    // Only runs: distances up to 3. Longer matches find little after filtering, and their codes cost more
    // than they save.
    stream_->hist_bits = 2;
    stream_->gzip_flag = IGZIP_DEFLATE;
    stream_->next_out = end_;
    stream_->avail_out = static_cast<uint32_t>(deflated_capacity_);
  }

  void pack(uint32_t y, uint8_t* row) const {
    const PictureView& picture = cut_.picture;
    pack_png_row(picture.row(y), picture.width, picture.wide, cut_.alpha, row);
  }

  // Returns the number of bytes in the band.
  size_t filter(uint32_t begin, uint32_t end) {
    uint8_t* out = band_.get();
    for (uint32_t y = begin; y < end; ++y, out += cut_.row_bytes + 1) {
      pack(y, row_);
      filter_png_row(row_, above_, cut_.row_bytes, cut_.pixel_bytes, out);
      std::swap(row_, above_);
    }
    return static_cast<size_t>(out - band_.get());
  }

  // Without the picture's end, the end of a stripe is flushed: it ends at a whole byte.
  bool deflate(size_t band_bytes, bool begins_stripe, bool ends_stripe, bool ends_picture) {
    const size_t alone = begins_stripe && band_bytes > kAlone ? kAlone : 0;
    stream_->next_in = band_.get();
    return (alone == 0 || feed(alone, SYNC_FLUSH, false)) &&
           feed(band_bytes - alone, ends_stripe && !ends_picture ? FULL_FLUSH : NO_FLUSH,
                ends_stripe && ends_picture);
  }

  bool feed(size_t bytes, uint16_t flush, bool ends_picture) {
    stream_->flush = flush;
    stream_->end_of_stream = ends_picture;
    stream_->avail_in = static_cast<uint32_t>(bytes);
    return isal_deflate(stream_.get()) == COMP_OK && stream_->avail_in == 0 && stream_->avail_out > 0;
  }

  const Cut& cut_;
  const size_t line_bytes_, deflated_capacity_;
  const std::unique_ptr<uint8_t[]> lines_;  // two packed rows
  uint8_t* row_ = lines_.get() + kPngMargin;
  uint8_t* above_ = row_ + line_bytes_;
  const std::unique_ptr<uint8_t[]> band_, level_, chunk_;
  const std::unique_ptr<isal_zstream> stream_;
  size_t filtered_bytes_ = 0;
  uint32_t adler_ = 1;
  uint8_t* end_ = nullptr;  // of what the chunk has so far
};

// A picture's threads. They count until its end, so that pictures at the same time share the CPUs.
class Threads {
 public:
  Threads(uint32_t asked, uint32_t stripes) {
    static const uint32_t cpus = usable_cpus();
    uint32_t before = taken;
    do {
      const uint32_t left = std::max(cpus, before + 1) - before;
      count_ = std::min(asked > 0 ? asked : left, stripes);
    } while (!taken.compare_exchange_weak(before, before + count_));
  }
  ~Threads() { taken -= count_; }
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;

  uint32_t count() const { return count_; }

 private:
  static inline std::atomic<uint32_t> taken{0};
  uint32_t count_;
};

class PixelWriter {
 public:
  PixelWriter(const Cut& cut, uint32_t threads, ByteSink sink) : cut_(cut), sink_(sink), crew_(threads) {
    for (uint32_t i = 0; i < crew_.threads(); ++i) idle_.push_back(&makers_.emplace_back(cut));
  }

  // Why it failed; null if it did not.
  const char* write() {
    crew_.run(cut_.stripes, [this](uint32_t stripe) { write(stripe); });
    absl::MutexLock lock(&mutex_);
    return failure_;
  }

 private:
  // Stripes begin in their order, so the one whose turn it is never waits for another.
  void write(uint32_t stripe) {
    ChunkMaker* const maker = take_maker();
    if (maker == nullptr) return;
    const bool made = maker->make(stripe);
    if (wait_for_turn(stripe)) end_turn(made ? send(*maker, stripe) : "isa-l failed");
    absl::MutexLock lock(&mutex_);
    idle_.push_back(maker);
  }

  // Null after a failure.
  ChunkMaker* take_maker() {
    absl::MutexLock lock(&mutex_);
    if (failure_ != nullptr) return nullptr;
    ChunkMaker* const maker = idle_.back();
    idle_.pop_back();
    return maker;
  }

  // False after a failure.
  bool wait_for_turn(uint32_t stripe) {
    const auto may_go = [this, stripe]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      return next_ == stripe || failure_ != nullptr;
    };
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(&may_go));
    return failure_ == nullptr;
  }

  void end_turn(const char* failure) {
    absl::MutexLock lock(&mutex_);
    ++next_;
    failure_ = failure;
  }

  // In its turn. Why it failed; null if it did not.
  const char* send(ChunkMaker& maker, uint32_t stripe) {
    adler_ = maker.adler_after(adler_);
    const auto [bytes, count] = maker.finish(stripe + 1 == cut_.stripes ? &adler_ : nullptr);
    return send_to(sink_, bytes, count);
  }

  const Cut& cut_;
  const ByteSink sink_;
  uint32_t adler_ = 1;  // of the rows that are written; used by the thread whose turn it is
  std::deque<ChunkMaker> makers_;
  absl::Mutex mutex_;
  uint32_t next_ ABSL_GUARDED_BY(mutex_) = 0;  // the stripe whose turn it is
  const char* failure_ ABSL_GUARDED_BY(mutex_) = nullptr;
  std::vector<ChunkMaker*> idle_ ABSL_GUARDED_BY(mutex_);
  Crew crew_;  // last, because its threads use all of the above
};

const char* send_to(ByteSink sink, const void* bytes, size_t count) try {
  return sink(bytes, count) ? nullptr : "write failed";
} catch (const std::bad_alloc&) {
  return "no memory";
}

// Writes the IDAT chunks of a picture whose size, depth and colour type (RGBA if `alpha`, else RGB; not
// interlaced) are already in the file. `threads` is that of PngOptions; each has memory of its own: 1.1 MB,
// or about that and five rows if they are long. The bytes depend on the picture alone.
//
// `sink` gets one chunk after the other, from any of the threads but never from two at the same time.
// INTERNAL if it returned false or memory ran out; it is not called again then.
absl::Status write_png_pixels(const PictureView& picture, bool alpha, uint32_t threads, ByteSink sink) try {
  const Cut cut(picture, alpha);
  const Threads taken(threads, cut.stripes);
  const char* failure = PixelWriter(cut, taken.count(), sink).write();
  return failure == nullptr ? absl::OkStatus() : absl::InternalError(failure);
} catch (const std::bad_alloc&) {
  return absl::InternalError("no memory");
}

struct PngFailure {
  char text[200] = "";
};

[[noreturn]] void on_error(png_structp png, png_const_charp message) {
  auto* failure = static_cast<PngFailure*>(png_get_error_ptr(png));
  std::snprintf(failure->text, sizeof failure->text, "%s", message);
  png_longjmp(png, 1);
}

void on_write(png_structp png, png_bytep bytes, size_t count) {
  const char* failure = send_to(*static_cast<ByteSink*>(png_get_io_ptr(png)), bytes, count);
  if (failure != nullptr) png_error(png, failure);
}

void on_flush(png_structp) {}

void on_warning(png_structp, png_const_charp) {}

void write_chunk(png_structp png, const char* kind, std::span<const png_byte> bytes) {
  png_write_chunk(png, reinterpret_cast<png_const_bytep>(kind), bytes.data(), bytes.size());
}

// What an HDR picture says of itself. This libpng does not know the chunks. They are those of PNG, third
// edition (W3C, 2025): sections "cICP", "mDCV", whose primaries stand in the order R, G, B, and "cLLI".
void write_hdr_chunks(png_structp png, EncodedTransfer transfer, const HdrDisplay& hdr) {
  const CodePoints code = code_points(transfer, hdr);
  const png_byte cicp[] = {code.primaries, code.transfer, 0, 1};  // R, G and B in the full range
  write_chunk(png, "cICP", cicp);

  const DisplayPoints points = display_points(hdr);
  png_byte mdcv[24] = {};  // the least luminance is 0
  png_byte* at = mdcv;
  for (const DisplayPoint& point : {points.red, points.green, points.blue, points.white}) {
    png_save_uint_16(at, point[0]);
    png_save_uint_16(at + 2, point[1]);
    at += 4;
  }
  png_save_uint_32(at, luminance_units(hdr.peak_nits));
  write_chunk(png, "mDCV", mdcv);

  if (!(hdr.max_light_nits > 0)) return;
  png_byte clli[8];
  png_save_uint_32(clli, luminance_units(hdr.max_light_nits));
  png_save_uint_32(clli + 4, luminance_units(hdr.mean_light_nits));
  write_chunk(png, "cLLI", clli);
}

// The file up to the pixels. False on failure. It has no locals with destructors, because libpng leaves it by
// longjmp.
bool write_head(png_structp png, png_infop info, ByteSink& sink, const PictureView& picture,
                const PngOptions& options, std::span<const png_text> text) {
  const EncodedTransfer transfer = options.transfer;
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_write_fn(png, &sink, on_write, on_flush);
  png_set_IHDR(png, info, picture.width, picture.height, picture.wide ? 16 : 8,
               options.alpha ? PNG_COLOR_TYPE_RGBA : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  if (!options.profile.empty()) {
    png_set_iCCP(png, info, "profile", PNG_COMPRESSION_TYPE_BASE,
                 reinterpret_cast<png_const_bytep>(options.profile.data()),
                 static_cast<png_uint_32>(options.profile.size()));
  } else if (transfer == EncodedTransfer::kSrgb) {
    png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
  } else if (!is_hdr(transfer) && transfer != EncodedTransfer::kUnknown) {
    png_set_gAMA(png, info, transfer == EncodedTransfer::kGamma22 ? 1 / 2.2 : 1.0);
    png_set_cHRM(png, info, 0.3127, 0.3290, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06);  // Rec.709, D65
  }
  if (picture.aspect_width != picture.aspect_height) {
    // Pixels per unit. Wider pixels mean fewer of them.
    png_set_pHYs(png, info, picture.aspect_height, picture.aspect_width, PNG_RESOLUTION_UNKNOWN);
  }
  if (!text.empty()) png_set_text(png, info, text.data(), static_cast<int>(text.size()));
  png_write_info(png, info);
  if (is_hdr(transfer)) write_hdr_chunks(png, transfer, options.hdr);
  return true;
}

// libpng's png_write_end() would miss the pixels, which it did not write.
bool write_end(png_structp png) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_chunk(png, reinterpret_cast<png_const_bytep>("IEND"), nullptr, 0);
  return true;
}

// The chunks point into the options.
std::vector<png_text> text_chunks(const PngOptions& options) {
  std::vector<png_text> chunks;
  for (const auto& [keyword, text] : options.text) {
    png_text chunk{};
    chunk.compression = PNG_TEXT_COMPRESSION_NONE;
    chunk.key = const_cast<char*>(keyword.c_str());  // libpng only reads them
    chunk.text = const_cast<char*>(text.c_str());
    chunk.text_length = text.size();
    chunks.push_back(chunk);
  }
  return chunks;
}

}  // namespace

absl::Status encode_png(const PictureView& picture, const PngOptions& options, ByteSink sink) {
  PngFailure failure;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &failure, on_error, on_warning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  const std::vector<png_text> text = text_chunks(options);
  absl::Status pixels;
  const bool written = info != nullptr && write_head(png, info, sink, picture, options, text) &&
                       (pixels = write_png_pixels(picture, options.alpha, options.threads, sink)).ok() &&
                       write_end(png);
  png_destroy_write_struct(&png, &info);
  if (written) return absl::OkStatus();
  return absl::InternalError(absl::StrCat("cannot encode the PNG: ", !pixels.ok()      ? pixels.message()
                                                                     : failure.text[0] ? failure.text
                                                                                       : "no memory"));
}

}  // namespace candela
#endif  // HWY_ONCE
