#include "client/image/read/image_stream.h"

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/read/exr/exr_take.h"
#include "client/image/read/pfm_header.h"
#include "client/image/read/png_take.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMostPfmHeader = 4096;  // with its comments

}  // namespace

// Of an OpenEXR file, several channels are not rendered.
uint64_t most_piped_bytes(const ImageLimits& limits) { return 4 * limits.max_bytes; }

absl::StatusOr<bool> take_piped(ByteSource& source, const std::string& name, const ImageLimits& limits,
                                uint64_t count, std::string& bytes) {
  const uint64_t most = most_piped_bytes(limits);
  if (count > most - std::min<uint64_t>(bytes.size(), most)) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "%s: it takes more than the %d bytes that a file in a pipe may have; give it as a file", name, most));
  }
  return source.take(count, bytes);
}

std::string ImageStream::name() const { return absl::StrFormat("%s, frame %d", name_, count_); }

std::optional<absl::StatusOr<Image>> ImageStream::next() {
  if (!lost_.ok()) return std::nullopt;
  std::string bytes;
  const bool begins = source_.take(4, bytes);
  if (bytes.empty() && source_.status().ok()) return std::nullopt;
  ++count_;
  if (begins) lost_ = take_file(bytes);
  lost_.Update(source_.status());
  if (!lost_.ok()) {
    if (!absl::StartsWith(lost_.message(), name())) {
      lost_ = absl::Status(lost_.code(), absl::StrFormat("%s: %s", name(), lost_.message()));
    }
    lost_ = input_failure(lost_, name());
    return lost_;
  }
  return read_image_bytes(name(), std::move(bytes), limits_, choice_);
}

absl::Status ImageStream::take_file(std::string& bytes) {
  if (bytes == "\x76\x2f\x31\x01") return take_exr(source_, name(), limits_, bytes);
  for (const char* pfm : {"PF", "Pf", "PH", "Ph"}) {
    if (absl::StartsWith(bytes, pfm)) return take_pfm(bytes);
  }
  if (bytes == "\x89PNG") return take_png(source_, name(), limits_, bytes);
  if (absl::StartsWith(bytes, "#?")) {
    return absl::UnimplementedError(absl::StrFormat(
        "%s: a Radiance file does not say where it ends; a pipe takes PFM, PHM, PNG and OpenEXR", name()));
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: here no PFM, PHM, PNG or OpenEXR file begins, so what follows cannot be read", name()));
}

absl::Status ImageStream::take_pfm(std::string& bytes) {
  size_t at = 0;
  const auto get = [&]() -> int {
    if (at == bytes.size()) {
      const int byte = bytes.size() < kMostPfmHeader ? source_.get() : -1;
      if (byte < 0) return -1;
      bytes.push_back(static_cast<char>(byte));
    }
    return static_cast<unsigned char>(bytes[at++]);
  };
  PfmWords words(get);
  ASSIGN_OR_RETURN(const PfmHeader header, read_pfm_header(words, name(), limits_, choice_.rows));
  words.finish_line();
  bytes.reserve(bytes.size() + header.bytes());
  source_.take(header.bytes(), bytes);
  return absl::OkStatus();
}

absl::StatusOr<Image> read_piped_image(int descriptor, const std::string& name, const ImageLimits& limits,
                                       const PictureChoice& choice) {
  ByteSource source(descriptor);
  std::string bytes;
  if (source.take(most_piped_bytes(limits) + 1, bytes)) {
    return input_failure(absl::ResourceExhaustedError(absl::StrFormat(
                             "%s: it has more than %d bytes, the most of a file in a pipe; give it as a file",
                             name, most_piped_bytes(limits))),
                         name);
  }
  if (!source.status().ok()) {
    return input_failure(
        absl::Status(source.status().code(), absl::StrFormat("%s: %s", name, source.status().message())),
        name);
  }
  return read_image_bytes(name, std::move(bytes), limits, choice);
}

}  // namespace candela
