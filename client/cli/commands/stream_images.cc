#include "client/cli/commands/stream_images.h"

#include <algorithm>
#include <fstream>
#include <new>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/cli/files/frame_files.h"
#include "client/image/write/atomic_file.h"
#include "client/image/write/encoded_aspect.h"

namespace candela {
namespace {

constexpr size_t kCopiedAtOnce = 1u << 20;  // bytes

// Writes a file that the server has encoded.
absl::StatusOr<std::vector<std::string>> write_bytes(const std::string& path, const RenderResult& result,
                                                     const FrameFacts& facts) {
  absl::StatusOr<AtomicFile> file = AtomicFile::create(path);
  if (!file.ok()) return file.status();
  write_with_aspect(*file, result.pixels(), facts.pixel_aspect);
  if (absl::Status status = file->commit(); !status.ok()) return status;
  if (facts.has_alpha && result.header.encoding() == v1::ENCODING_JPEG) {
    return std::vector<std::string>{kNoAlphaInJpeg};
  }
  return std::vector<std::string>();
}

absl::StatusOr<std::vector<std::string>> write_result(const std::string& path, const RenderResult& result,
                                                      const FrameFacts& facts,
                                                      const WriteOptions& options) try {
  if (result.header.encoding() == v1::ENCODING_NONE) return std::vector<std::string>();
  if (result.header.encoded_bytes() > 0) return write_bytes(path, result, facts);
  absl::StatusOr<Image> picture = picture_of(result, facts.has_alpha, facts.pixel_aspect);
  if (!picture.ok()) return picture.status();
  picture->frame_rate = facts.frame_rate;
  picture->kept = facts.kept;
  return write_image(path, *picture, options);
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError(
      absl::StrFormat("%s: out of memory; give this process more memory (ulimit -v)", path));
}

absl::Status copy_file(const std::string& from, const std::string& to) {
  std::ifstream source(from, std::ios::binary);
  if (!source)
    return absl::NotFoundError(absl::StrFormat(
        "%s: cannot read it to repeat it as %s; leave the images in place until the command ends", from, to));
  absl::StatusOr<AtomicFile> file = AtomicFile::create(to);
  if (!file.ok()) return file.status();
  std::vector<char> bytes(kCopiedAtOnce);
  while (source) {
    source.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    if (!file->write(bytes.data(), static_cast<size_t>(source.gcount()))) break;
  }
  if (source.bad()) return absl::UnavailableError(absl::StrFormat("%s: cannot read it to repeat it", from));
  return file->commit();
}

}  // namespace

absl::Status StreamImages::write(StreamFrame frame, RenderResult image, const FrameFacts& facts,
                                 std::vector<StreamFrame> holds) {
  const std::string path = frame.output;
  entries_.push_back({std::move(frame), std::move(holds),
                      std::async(std::launch::async, [this, path, facts, image = std::move(image)] {
                        return write_result(path, image, facts, options_);
                      })});
  return keep_bounded();
}

absl::Status StreamImages::skip(StreamFrame frame, std::vector<StreamFrame> holds) {
  entries_.push_back({std::move(frame), std::move(holds), {}});
  return keep_bounded();
}

absl::Status StreamImages::finish() {
  absl::Status status;
  while (!entries_.empty()) status.Update(finish_oldest());
  return status;
}

absl::Status StreamImages::keep_bounded() {
  const size_t most = std::max<size_t>(2, std::thread::hardware_concurrency());
  absl::Status status;
  while (status.ok() && entries_.size() > most) status = finish_oldest();
  return status;
}

// Waits until the oldest image is written, and reports it.
absl::Status StreamImages::finish_oldest() {
  Entry oldest = std::move(entries_.front());
  entries_.pop_front();
  return oldest.written.valid() ? finish_written(oldest) : finish_skipped(oldest);
}

absl::Status StreamImages::finish_written(Entry& entry) {
  absl::StatusOr<std::vector<std::string>> notes = entry.written.get();
  if (!notes.ok()) return notes.status();
  summary_.notes.insert(notes->begin(), notes->end());
  ++summary_.written;
  summary_.latency += entry.frame.latency;
  absl::Status status = json_.add(to_json(entry.frame));
  for (const StreamFrame& held : entry.holds) {
    if (status.ok()) status = copy_file(entry.frame.output, held.output);
    if (status.ok()) status = json_.add(to_json(held));
    if (!status.ok()) return status;
    ++summary_.held;
  }
  return status;
}

absl::Status StreamImages::finish_skipped(Entry& entry) {
  ++summary_.skipped;
  progress_.clear();
  if (!quiet_) print_note("skipped: " + std::string(entry.frame.status.message()));
  absl::Status status = json_.add(to_json(entry.frame));
  for (StreamFrame& held : entry.holds) {
    held.status =
        absl::NotFoundError(absl::StrFormat("frame %d, which it repeats, has no image", entry.frame.number));
    if (status.ok()) status = json_.add(to_json(held));
  }
  return status;
}

}  // namespace candela
