#include "client/call/link_pace.h"

#include <algorithm>

namespace candela {
namespace {

// A core compresses 500 to 900 MB/s and another one decompresses as much, so this leaves each of them most of
// its time. 1 Gbit/s is 117 MB/s; loopback takes more than 600.
constexpr double kSlowBytesPerSecond = 200e6;
// The first bands show how soon the server takes a frame, which may wait for its memory there. So does the
// slowest of the others, because HTTP/2's window may take some of them before.
constexpr uint64_t kFirstMeasuredBand = 2;
// After as many compressed frames one is not, because the link may have become faster.
constexpr uint64_t kFramesBetweenLooks = 64;

}  // namespace

bool LinkPace::next_frame() {
  if (bytes_ > largest_) {
    const auto bytes = static_cast<double>(bytes_ - largest_);
    slow_ = bytes < kSlowBytesPerSecond * absl::ToDoubleSeconds(time_ - longest_);
  }
  bytes_ = largest_ = 0;
  time_ = longest_ = absl::ZeroDuration();
  const bool compress = slow_ && compressed_ < kFramesBetweenLooks;
  compressed_ = compress ? compressed_ + 1 : 0;
  return compress;
}

void LinkPace::wrote(uint64_t index, uint64_t bytes, absl::Duration time) {
  if (index < kFirstMeasuredBand) return;
  bytes_ += bytes;
  largest_ = std::max(largest_, bytes);
  time_ += time;
  longest_ = std::max(longest_, time);
}

}  // namespace candela
