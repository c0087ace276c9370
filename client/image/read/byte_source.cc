#include "client/image/read/byte_source.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace candela {
namespace {

constexpr size_t kBuffered = 1u << 16, kTakenAtOnce = 1u << 20;

}  // namespace

ByteSource::ByteSource(int descriptor)
    : descriptor_(descriptor), stopped_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)), buffer_(kBuffered) {}

ByteSource::~ByteSource() {
  if (stopped_ >= 0) close(stopped_);
}

int ByteSource::get() {
  if (at_ == end_) {
    at_ = 0;
    end_ = read_some(buffer_.data(), buffer_.size());
    if (end_ == 0) return -1;
  }
  return static_cast<unsigned char>(buffer_[at_++]);
}

bool ByteSource::take(uint64_t count, std::string& bytes) {
  const size_t buffered = std::min<uint64_t>(count, end_ - at_);
  bytes.append(buffer_.data() + at_, buffered);
  at_ += buffered;
  for (uint64_t left = count - buffered; left > 0;) {
    const size_t had = bytes.size(), wanted = std::min<uint64_t>(left, kTakenAtOnce);
    bytes.resize(had + wanted);
    const size_t got = read_some(bytes.data() + had, wanted);
    bytes.resize(had + got);
    if (got == 0) return false;
    left -= got;
  }
  return true;
}

void ByteSource::stop() {
  const uint64_t one = 1;
  if (stopped_ >= 0) (void)!write(stopped_, &one, sizeof one);
}

absl::Status ByteSource::status() const {
  return error_ == 0 ? absl::OkStatus() : absl::ErrnoToStatus(error_, "cannot read");
}

size_t ByteSource::read_some(char* to, size_t most) {
  while (!ended_) {
    pollfd waits[] = {{descriptor_, POLLIN, 0}, {stopped_, POLLIN, 0}};  // poll() ignores -1
    if (poll(waits, 2, -1) < 0 && errno == EINTR) continue;
    if (waits[1].revents != 0) break;
    const ssize_t count = read(descriptor_, to, most);
    if (count > 0) return static_cast<size_t>(count);
    if (count < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (count < 0) error_ = errno;
    break;
  }
  ended_ = true;
  return 0;
}

}  // namespace candela
