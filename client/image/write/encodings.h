// The encodings that image files are written in: a row each. What differs between them stands here and in
// their writers, nowhere else.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/image/image.h"

namespace candela {

class AtomicFile;

using Notes = std::vector<std::string>;  // messages for the user

struct OutputEncoding {
  const char* name;                     // "PNG"
  std::vector<std::string> extensions;  // ".png"; the first is that of new files
  // What it is written from. Codes of a display, 8 bits first, or light in half or full floats.
  std::vector<ImageFormat> formats;
  v1::Alpha alpha;      // that it is meant to hold; UNSPECIFIED: it has none
  v1::Encoding server;  // by which a server encodes it; RAW: only the client does
  bool lossy;           // it loses detail, the less the higher the quality is
  bool hdr;             // it has words for PQ and HLG
  // Writes an image in one of the formats. Errors of `file` itself may be left to its commit().
  absl::Status (*write)(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes);

  const std::string& extension() const { return extensions.front(); }
  bool has_alpha() const { return alpha != v1::ALPHA_UNSPECIFIED; }
  // It is made from 16 bits, whatever it holds.
  bool needs_16_bits() const { return formats.front() == ImageFormat::kRgba16; }
  bool takes_8_bits() const { return formats.front() == ImageFormat::kRgba8; }
  // A y4m, which no function here writes.
  bool is_film() const { return needs_16_bits() && write == nullptr; }
  bool holds_codes() const { return needs_16_bits() || takes_8_bits(); }
  bool holds_light() const { return !holds_codes(); }
  bool names_primaries() const { return holds_codes() && write != nullptr; }
  bool has_quality() const { return lossy; }
  bool has_hdr() const { return hdr; }
  bool has_straight_alpha() const { return alpha == v1::ALPHA_STRAIGHT; }
  bool has_16_bits() const { return holds_codes() && formats.size() > 1; }
};

// All of them. The first is that of a folder, if the user names none.
std::span<const OutputEncoding> output_encodings();

// The encoding by the path's extension, in upper or lower case. For another extension INVALID_ARGUMENT, with
// a list of the possible ones. Never null.
absl::StatusOr<const OutputEncoding*> output_encoding(const std::string& path);

// The encoding of the files that a server makes, or of those that the client makes in a folder by default.
const OutputEncoding& output_encoding(v1::Encoding by_server);

// ".png, .jpg or .exr": the extension of each encoding for which `member` is true; of all without it.
std::string extensions_with(bool (OutputEncoding::*member)() const = nullptr);

// Writes a file that a server has encoded, as write_image() writes one. If the pixels are not square, the
// file says so; a server knows no aspect. `has_alpha` says that the frame had it.
absl::StatusOr<Notes> write_encoded(const std::string& path, std::span<const std::byte> file,
                                    v1::Encoding encoding, bool has_alpha, double pixel_aspect);

}  // namespace candela
