#include "client/image/read/png_take.h"

#include <cstdint>

#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "client/image/read/image_stream.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr absl::string_view kPngSignature("\x89PNG\r\n\x1a\n", 8);
constexpr size_t kChunkHead = 8, kCrc = 4, kIhdrBytes = 13;

absl::Status not_png(const std::string& name, const std::string& what) {
  return absl::InvalidArgumentError(absl::StrFormat("%s: damaged PNG file: %s", name, what));
}

}  // namespace

absl::Status take_png(ByteSource& source, const std::string& name, const ImageLimits& limits,
                      std::string& bytes) {
  const auto take = [&](uint64_t count) { return take_piped(source, name, limits, count, bytes); };
  ASSIGN_OR_RETURN(bool whole, take(kPngSignature.size() - bytes.size()));
  if (whole && bytes != kPngSignature) return not_png(name, "its first 8 bytes are not those of a PNG");
  bool is_first = true, is_last = false;
  while (whole && !is_last) {
    ASSIGN_OR_RETURN(whole, take(kChunkHead));
    if (!whole) break;
    const size_t at = bytes.size() - kChunkHead;
    const uint32_t size = big_endian_at(bytes, at);
    const std::string kind = bytes.substr(at + 4, 4);
    if (is_first && (kind != "IHDR" || size != kIhdrBytes)) return not_png(name, "it begins without IHDR");
    ASSIGN_OR_RETURN(whole, take(uint64_t{size} + kCrc));
    if (is_first && whole) {
      RETURN_IF_ERROR(check_image_size(name, "image", big_endian_at(bytes, at + kChunkHead),
                                       big_endian_at(bytes, at + kChunkHead + 4), ImageFormat::kRgba32f,
                                       limits));
    }
    is_first = false;
    is_last = kind == "IEND";
  }
  return absl::OkStatus();
}

}  // namespace candela
