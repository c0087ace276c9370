// The pixels of a PNG file. Internal to server/encode.
#include <isa-l/crc.h>
#include <isa-l/igzip_lib.h>
#include <png.h>
#include <zlib.h>

#include <algorithm>
#include <atomic>
#include <csetjmp>
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
#include "server/encode/png_filter.h"

namespace candela {
namespace {

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
  if (transfer == EncodedTransfer::kSrgb) {
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
