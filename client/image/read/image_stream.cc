#include "client/image/read/image_stream.h"

#include <algorithm>
#include <span>
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
constexpr size_t kMostY4mLine = 4096;

// The bytes of a y4m up to the line end, which is taken, too.
absl::StatusOr<std::string> take_line(ByteSource& source, const std::string& name) {
  std::string line;
  for (int byte = source.get(); byte != '\n'; byte = source.get()) {
    if (byte < 0 || line.size() == kMostY4mLine) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: a line of the y4m does not end within %d bytes", name, kMostY4mLine));
    }
    line.push_back(static_cast<char>(byte));
  }
  return line;
}

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
  return picture_of(std::move(bytes));
}

absl::StatusOr<Image> ImageStream::picture_of(std::string bytes) const {
  if (!has_planes_) return read_image_bytes(name(), std::move(bytes), limits_, choice_);
  if (const uint64_t wanted = y4m_->frame_bytes(); bytes.size() < wanted) {
    return input_failure(absl::InvalidArgumentError(absl::StrFormat(
                             "%s: the file is truncated: %d of %d bytes of the frame are missing", name(),
                             wanted - bytes.size(), wanted)),
                         name());
  }
  return y4m_->image(std::as_bytes(std::span(bytes)));
}

absl::Status ImageStream::take_file(std::string& bytes) {
  has_planes_ = false;
  if (bytes == kY4mMagic.substr(0, 4)) {
    RETURN_IF_ERROR(begin_y4m(bytes));
  }
  if (y4m_ && bytes == kY4mFrame.substr(0, 4)) return take_planes(bytes);
  if (bytes == "\x76\x2f\x31\x01") return take_exr(source_, name(), limits_, bytes);
  for (const char* pfm : {"PF", "Pf", "PH", "Ph"}) {
    if (absl::StartsWith(bytes, pfm)) return take_pfm(bytes);
  }
  if (bytes == "\x89PNG") return take_png(source_, name(), limits_, bytes);
  if (absl::StartsWith(bytes, "#?")) {
    return absl::UnimplementedError(absl::StrFormat(
        "%s: a Radiance file does not say where it ends; a pipe takes PFM, PHM, PNG, OpenEXR and y4m",
        name()));
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: here no PFM, PHM, PNG, OpenEXR or y4m begins, so what follows cannot be read", name()));
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

absl::Status ImageStream::begin_y4m(std::string& bytes) {
  ASSIGN_OR_RETURN(const std::string line, take_line(source_, name()));
  ASSIGN_OR_RETURN(y4m_, Y4mFrames::of(name(), bytes + line, limits_, choice_));
  bytes.clear();
  if (source_.take(4, bytes)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("%s: the y4m ends before its first frame", name()));
}

absl::Status ImageStream::take_planes(std::string& bytes) {
  ASSIGN_OR_RETURN(const std::string line, take_line(source_, name()));
  if (const std::string word = bytes + line; word != kY4mFrame && !absl::StartsWith(word, "FRAME ")) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: a y4m's frame begins with FRAME, and here is %s", name(), printable(word)));
  }
  bytes.clear();
  has_planes_ = true;
  source_.take(y4m_->frame_bytes(), bytes);
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
