// The writers of the encodings, for their table. Internal to client/image.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "client/image/write/atomic_file.h"
#include "client/image/write/encodings.h"
#include "server/encode/picture.h"

namespace candela {

absl::Status write_exr(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes);
absl::Status write_tiff(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes);
absl::Status write_avif(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes);
absl::Status write_pfm(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes);

// A checked image and options. The same ones give the same bytes with any number of threads. INTERNAL with
// the reason, or if the sink returned false.
absl::Status encode_avif(const Image& image, const WriteOptions& options, int threads, ByteSink sink);

// The ICC profile of an image whose primaries are not Rec.709's; "" of others.
std::string profile_of_primaries(const WriteOptions& options);

// A pixel's width : height as the nearest fraction of 16-bit numbers.
struct AspectRatio {
  uint16_t width = 1;
  uint16_t height = 1;
};
AspectRatio aspect_ratio(double pixel_aspect);

// Writes the PNG or JPEG `encoded`, which says nothing of its pixels' aspect. If they are not square, it says
// so: in a pHYs chunk before the pixels, or in the JFIF density. Bytes of another kind are written as they
// are.
void write_with_aspect(AtomicFile& file, std::span<const std::byte> encoded, double pixel_aspect);

}  // namespace candela
