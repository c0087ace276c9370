#include "client/image/read/exr_zip.h"

// What is left: the baseline, SSE4, AVX2, AVX-512 and NEON.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "client/image/read/exr_zip.cc"
#include <hwy/foreach_target.h>
// Only after foreach_target.h.
#include <OpenEXR/Iex.h>
#include <OpenEXR/IlmThreadPool.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfPartType.h>
#include <half.h>
#include <hwy/highway.h>
#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <limits>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <span>
#include <string>

#include "absl/strings/str_format.h"
#include "client/image/read/exr_file.h"

namespace candela {

// Where a row's red, green, blue and alpha begin, each little endian and one after the other; null: there is
// none, and it becomes 0, or 1 for alpha.
using RowPlanes = std::array<const uint8_t*, 4>;

}  // namespace candela

HWY_BEFORE_NAMESPACE();
namespace candela {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Kernels for the chunks of an OpenEXR file. Highway chooses the instruction set when they run. The sizes are
// any; nothing needs to be aligned. Each kernel is a loop over vectors and one over the rest. The baseline,
// HWY_SCALAR, has no vectors.

void undo_predictor_here(uint8_t* bytes, size_t count) {
  size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::FixedTag<uint8_t, 16> d;
  const auto bias = hn::Set(d, 128);
  const auto last = hn::Set(d, 15);
  auto before = bias;  // takes back the bias of the first byte, which has none
  for (; i + 16 <= count; i += 16) {
    auto sum = hn::Add(hn::LoadU(d, bytes + i), bias);
    sum = hn::Add(sum, hn::ShiftLeftBytes<1>(sum));
    sum = hn::Add(sum, hn::ShiftLeftBytes<2>(sum));
    sum = hn::Add(sum, hn::ShiftLeftBytes<4>(sum));
    sum = hn::Add(sum, hn::ShiftLeftBytes<8>(sum));
    hn::StoreU(hn::Add(sum, before), d, bytes + i);
    before = hn::Add(before, hn::TableLookupBytes(sum, last));  // the only step that waits for the last turn
  }
#endif
  auto value = static_cast<uint8_t>(i == 0 ? 128 : bytes[i - 1]);
  for (; i < count; ++i) bytes[i] = value = static_cast<uint8_t>(value + bytes[i] + 128);
}

void interleave_bytes_here(const uint8_t* even, const uint8_t* odd, uint8_t* out, size_t count) {
  size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<uint8_t> d;
  for (; 2 * (i + hn::Lanes(d)) <= count; i += hn::Lanes(d)) {
    hn::StoreInterleaved2(hn::LoadU(d, even + i), hn::LoadU(d, odd + i), d, out + 2 * i);
  }
#endif
  for (i *= 2; i < count; ++i) out[i] = i % 2 == 0 ? even[i / 2] : odd[i / 2];
}

template <typename T>
void planes_to_rgba(const RowPlanes& planes, T one, std::byte* rgba, size_t pixels) {
  auto* out = reinterpret_cast<T*>(rgba);
  const auto fill = [&](size_t c) { return c == 3 ? one : T{0}; };
  size_t x = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<T> d;
  const hn::Repartition<uint8_t, decltype(d)> bytes;
  const auto load = [&](size_t c) {
    return planes[c] == nullptr ? hn::Set(d, fill(c))
                                : hn::BitCast(d, hn::LoadU(bytes, planes[c] + x * sizeof(T)));
  };
  for (; x + hn::Lanes(d) <= pixels; x += hn::Lanes(d)) {
    hn::StoreInterleaved4(load(0), load(1), load(2), load(3), d, out + 4 * x);
  }
#endif
  for (; x < pixels; ++x) {
    for (size_t c = 0; c < 4; ++c) {
      T value = fill(c);
      if (planes[c] != nullptr) std::memcpy(&value, planes[c] + x * sizeof(T), sizeof(T));
      out[4 * x + c] = value;
    }
  }
}

void halves_to_rgba_here(const RowPlanes& planes, std::byte* rgba, size_t pixels) {
  planes_to_rgba<uint16_t>(planes, 0x3c00, rgba, pixels);
}

void floats_to_rgba_here(const RowPlanes& planes, std::byte* rgba, size_t pixels) {
  planes_to_rgba<uint32_t>(planes, 0x3f800000, rgba, pixels);
}

}  // namespace HWY_NAMESPACE
}  // namespace candela
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace candela {
namespace {

HWY_EXPORT(undo_predictor_here);
HWY_EXPORT(interleave_bytes_here);
HWY_EXPORT(halves_to_rgba_here);
HWY_EXPORT(floats_to_rgba_here);

// Undoes OpenEXR's predictor in place: each byte is 128 less than its difference to the one before.
void undo_predictor(std::span<uint8_t> bytes) {
  HWY_DYNAMIC_DISPATCH(undo_predictor_here)(bytes.data(), bytes.size());
}

// Bytes 0, 2, 4 ... of `out` come from `even`, and 1, 3, 5 ... from `odd`.
void interleave_bytes(const uint8_t* even, const uint8_t* odd, std::span<uint8_t> out) {
  HWY_DYNAMIC_DISPATCH(interleave_bytes_here)(even, odd, out.data(), out.size());
}

// Writes `pixels` of four halves.
void halves_to_rgba(const RowPlanes& planes, std::byte* rgba, size_t pixels) {
  HWY_DYNAMIC_DISPATCH(halves_to_rgba_here)(planes, rgba, pixels);
}

// Writes `pixels` of four floats.
void floats_to_rgba(const RowPlanes& planes, std::byte* rgba, size_t pixels) {
  HWY_DYNAMIC_DISPATCH(floats_to_rgba_here)(planes, rgba, pixels);
}

static_assert(std::endian::native == std::endian::little, "the file's numbers are little endian");

size_t bytes_of(Imf::PixelType type) { return type == Imf::HALF ? 2 : 4; }

// Where the channels lie. A row has all of the first channel's values, then those of the next.
struct ZipLayout {
  struct Plane {
    size_t at;  // bytes from the row's start
    Imf::PixelType type;
  };

  ZipLayout(const Imf::Header& header, const ExrChannels& channels, ImageFormat to)
      : data(header.dataWindow()),
        chunk_rows(rows_of_chunk(header.compression())),
        upwards(header.lineOrder() != Imf::INCREASING_Y),
        format(to) {
    const std::string* const names[] = {&channels.red, &channels.green, &channels.blue, &channels.alpha};
    for (auto i = header.channels().begin(); i != header.channels().end(); ++i) {
      for (size_t c = 0; c < planes.size(); ++c) {
        if (*names[c] == i.name()) planes[c] = {row_bytes, i.channel().type};
      }
      row_bytes += width() * bytes_of(i.channel().type);
    }
  }

  size_t width() const { return static_cast<size_t>(data.width()); }

  Window data;
  int64_t chunk_rows;  // of all chunks but the last, which may have less
  bool upwards;        // the chunks are stored from the bottom
  ImageFormat format;
  size_t row_bytes = 0;
  std::array<std::optional<Plane>, 4> planes;
};

// Decodes one chunk after the other. Used by one thread.
class ChunkDecoder {
 public:
  explicit ChunkDecoder(const ZipLayout& layout)
      : layout_(layout),
        inflate_(libdeflate_alloc_decompressor()),
        // OpenEXR checks a chunk's length against whole chunks, for the last one, too.
        stored_(new_bytes(layout.row_bytes * static_cast<size_t>(layout.chunk_rows))),
        inflated_(new_bytes(layout.row_bytes * static_cast<size_t>(chunk_rows_at(layout.data.y0)))),
        rows_(new_bytes(2 * 4 * kMostBytes * layout.width())) {
    if (inflate_ == nullptr) throw std::bad_alloc();
  }

  // Takes the chunk that begins with row y from the file. One thread at a time.
  void fetch(const Imf::InputPart& input, int64_t y) {
    y_ = y;
    int size = 0;
    input.rawPixelDataToBuffer(static_cast<int>(y), reinterpret_cast<char*>(stored_.get()), size);
    stored_bytes_ = static_cast<size_t>(size);
  }

  // Writes those of the chunk's rows that are among y0 to y1. For `origin` see ReadRows.
  void decode(char* origin, size_t row_bytes, int64_t y0, int64_t y1) {
    const int64_t rows = chunk_rows_at(y_);
    bytes_ = layout_.row_bytes * static_cast<size_t>(rows);
    is_split_ = stored_bytes_ < bytes_;  // what ZIP would not make smaller is stored as it is
    if (is_split_) {
      if (libdeflate_zlib_decompress(inflate_.get(), stored_.get(), stored_bytes_, inflated_.get(), bytes_,
                                     nullptr) != LIBDEFLATE_SUCCESS) {
        throw Iex::InputExc(
            absl::StrFormat("rows %d to %d do not decompress to their pixels", y_, y_ + rows - 1));
      }
      undo_predictor({inflated_.get(), bytes_});
    }
    const auto x = static_cast<uintptr_t>(layout_.data.x0) * bytes_per_pixel(layout_.format);
    for (int64_t y = std::max(y_, y0); y <= std::min(y_ + rows - 1, y1); ++y) {
      RowPlanes planes{};
      for (size_t c = 0; c < planes.size(); ++c) {
        if (layout_.planes[c]) planes[c] = row_of(c, *layout_.planes[c], static_cast<size_t>(y - y_));
      }
      auto* to = reinterpret_cast<std::byte*>(reinterpret_cast<uintptr_t>(origin) + x +
                                              static_cast<uintptr_t>(y) * row_bytes);
      (layout_.format == ImageFormat::kRgba16f ? halves_to_rgba : floats_to_rgba)(planes, to,
                                                                                  layout_.width());
    }
  }

 private:
  using Bytes = std::unique_ptr<uint8_t[]>;
  struct Free {
    void operator()(libdeflate_decompressor* d) const { libdeflate_free_decompressor(d); }
  };
  static constexpr size_t kMostBytes = 4;  // of a value

  // Not zeroed: most pages of a long chunk are never touched if it is stored in a few bytes.
  static Bytes new_bytes(size_t count) { return std::make_unique_for_overwrite<uint8_t[]>(count); }

  int64_t chunk_rows_at(int64_t y) const { return std::min(layout_.chunk_rows, layout_.data.y1 - y + 1); }

  // A channel's values in a row of the chunk, in the type of the format.
  const uint8_t* row_of(size_t c, const ZipLayout::Plane& plane, size_t row) {
    const size_t at = row * layout_.row_bytes + plane.at, size = layout_.width() * bytes_of(plane.type);
    const uint8_t* values = stored_.get() + at;
    if (is_split_) {  // the first half has the bytes 0, 2, 4 ... of the chunk, the second 1, 3, 5 ...
      uint8_t* whole = rows_.get() + c * kMostBytes * layout_.width();
      const uint8_t* even = inflated_.get() + at / 2;
      interleave_bytes(even, even + bytes_ / 2, {whole, size});
      values = whole;
    }
    if (layout_.format == ImageFormat::kRgba16f || plane.type == Imf::FLOAT) return values;
    uint8_t* floats = rows_.get() + (4 + c) * kMostBytes * layout_.width();
    for (size_t x = 0; x < layout_.width(); ++x) {
      const float value = plane.type == Imf::HALF ? imath_half_to_float(load<uint16_t>(values, x))
                                                  : static_cast<float>(load<uint32_t>(values, x));
      std::memcpy(floats + x * sizeof value, &value, sizeof value);
    }
    return floats;
  }

  template <typename T>
  static T load(const uint8_t* values, size_t x) {
    T value;
    std::memcpy(&value, values + x * sizeof value, sizeof value);
    return value;
  }

  const ZipLayout& layout_;
  const std::unique_ptr<libdeflate_decompressor, Free> inflate_;
  const Bytes stored_, inflated_;
  const Bytes rows_;  // four rows of whole values, then four of floats
  int64_t y_ = 0;
  size_t stored_bytes_ = 0, bytes_ = 0;
  bool is_split_ = false;
};

// Reads rows y0 to y1 with several threads.
class RowsReader {
 public:
  RowsReader(const ZipLayout& layout, const Imf::InputPart& input, char* origin, size_t row_bytes, int64_t y0,
             int64_t y1)
      : layout_(layout),
        input_(input),
        origin_(origin),
        row_bytes_(row_bytes),
        y0_(y0),
        y1_(y1),
        first_((y0 - layout.data.y0) / layout.chunk_rows),
        chunks_((y1 - layout.data.y0) / layout.chunk_rows - first_ + 1) {}

  void run(int threads) {
    const int64_t workers = std::min<int64_t>(threads, chunks_);
    if (workers <= 1) {
      work();
    } else {
      IlmThread::TaskGroup group;
      for (int64_t i = 0; i < workers; ++i) IlmThread::ThreadPool::addGlobalTask(new Worker(group, *this));
    }
    const std::lock_guard lock(mutex_);
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  class Worker : public IlmThread::Task {
   public:
    Worker(IlmThread::TaskGroup& group, RowsReader& reader) : Task(&group), reader_(reader) {}
    void execute() override { reader_.work(); }

   private:
    RowsReader& reader_;
  };

  void work() {
    int64_t chunk = 0;
    try {
      ChunkDecoder decoder(layout_);
      while (fetch_next(decoder, chunk)) decoder.decode(origin_, row_bytes_, y0_, y1_);
    } catch (...) {
      const std::lock_guard lock(mutex_);
      if (chunk < failed_) failed_ = chunk, failure_ = std::current_exception();
    }
  }

  // Always in the file's order. OpenEXR takes the next chunk from where the last one ends, and looks into the
  // file's table of chunks only for another one. In any order, what a file with a damaged table gives would
  // depend on time.
  bool fetch_next(ChunkDecoder& decoder, int64_t& chunk) {
    const std::lock_guard lock(mutex_);
    if (next_ >= std::min(chunks_, failed_)) return false;
    chunk = next_++;
    const int64_t number = first_ + (layout_.upwards ? chunks_ - 1 - chunk : chunk);
    decoder.fetch(input_, layout_.data.y0 + number * layout_.chunk_rows);
    return true;
  }

  const ZipLayout& layout_;
  const Imf::InputPart& input_;
  char* const origin_;
  const size_t row_bytes_;
  const int64_t y0_, y1_;
  const int64_t first_, chunks_;
  std::mutex mutex_;
  int64_t next_ = 0;  // in the file's order, as the following
  int64_t failed_ = std::numeric_limits<int64_t>::max();
  std::exception_ptr failure_;
};

}  // namespace

bool has_zip_rows(const Imf::Header& header) {
  if (header.hasTileDescription() || (header.hasType() && header.type() != Imf::SCANLINEIMAGE)) return false;
  if (header.compression() != Imf::ZIP_COMPRESSION && header.compression() != Imf::ZIPS_COMPRESSION)
    return false;
  for (auto i = header.channels().begin(); i != header.channels().end(); ++i) {
    if (i.channel().xSampling != 1 || i.channel().ySampling != 1) return false;
  }
  return true;
}

ReadRows zip_rows(Imf::InputPart& input, const ExrChannels& channels, ImageFormat format, int threads) {
  return [&input, layout = ZipLayout(input.header(), channels, format), threads](
             char* origin, size_t row_bytes, int64_t y0, int64_t y1) {
    RowsReader(layout, input, origin, row_bytes, y0, y1).run(threads);
  };
}

}  // namespace candela
#endif  // HWY_ONCE
