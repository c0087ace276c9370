#include "client/call/shared_memory.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {

constexpr uint64_t kPageBytes = 4096;
constexpr char kProtocol = 1;
constexpr timeval kAnswerLimit = {2, 0};

absl::Status cannot(const char* what) {
  return absl::UnavailableError(absl::StrFormat("no shared memory: %s: %s", what, std::strerror(errno)));
}

absl::Status pass_on(int connection, int descriptor) {
  char byte = kProtocol;
  iovec part{&byte, 1};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> control{};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  cmsghdr* const header = CMSG_FIRSTHDR(&message);
  header->cmsg_level = SOL_SOCKET;
  header->cmsg_type = SCM_RIGHTS;
  header->cmsg_len = CMSG_LEN(sizeof(int));
  std::memcpy(CMSG_DATA(header), &descriptor, sizeof descriptor);
  return sendmsg(connection, &message, MSG_NOSIGNAL) == 1 ? absl::OkStatus() : cannot("sendmsg");
}

// The server answers in one piece, or closes.
absl::StatusOr<std::string> take_ticket(int connection) {
  std::string answer(v1::kMaxMemoryReplyBytes, '\0');
  const ssize_t size = TEMP_FAILURE_RETRY(recv(connection, answer.data(), answer.size(), 0));
  if (size < 0) return cannot("recv");
  if (size == 0) return absl::UnavailableError("no shared memory: the server closes the connection");
  answer.resize(static_cast<size_t>(size));
  if (answer.front() == 0 && answer.size() == 1 + v1::kMemoryTicketBytes) return answer.substr(1);
  if (answer.front() == 0) return absl::InternalError("the server's ticket is not one of docs/transport.md");
  return absl::Status(static_cast<absl::StatusCode>(answer.front()), answer.substr(1));
}

absl::StatusOr<int> connect_to_door(const std::string& path) {
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  if (path.size() >= sizeof to.sun_path) {
    return absl::UnavailableError("no shared memory: the socket's path is too long");
  }
  std::memcpy(to.sun_path, path.data(), path.size());
  const int connection = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (connection < 0) return cannot("socket");
  setsockopt(connection, SOL_SOCKET, SO_RCVTIMEO, &kAnswerLimit, sizeof kAnswerLimit);
  setsockopt(connection, SOL_SOCKET, SO_SNDTIMEO, &kAnswerLimit, sizeof kAnswerLimit);
  if (connect(connection, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0) return connection;
  absl::Status status = cannot("connect");
  close(connection);
  return status;
}

}  // namespace

absl::StatusOr<std::shared_ptr<SharedRegion>> SharedRegion::create(const std::string& path, uint64_t bytes) {
  const absl::StatusOr<int> connection = connect_to_door(path + v1::kMemorySuffix);
  if (!connection.ok()) return connection.status();
  std::shared_ptr<SharedRegion> region(new SharedRegion);
  region->connection_ = *connection;
  const int descriptor = memfd_create("candela", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (descriptor < 0) return cannot("memfd_create");
  const absl::Cleanup closing = [descriptor] { close(descriptor); };
  if (ftruncate(descriptor, static_cast<off_t>(bytes)) != 0) return cannot("ftruncate");
  if (fcntl(descriptor, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) != 0) return cannot("fcntl");
  void* const at = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  if (at == MAP_FAILED) return cannot("mmap");
  region->data_ = static_cast<std::byte*>(at);
  region->bytes_ = bytes;
  if (absl::Status passed = pass_on(*connection, descriptor); !passed.ok()) return passed;
  absl::StatusOr<std::string> ticket = take_ticket(*connection);
  if (!ticket.ok()) return ticket.status();
  region->ticket_ = *std::move(ticket);
  return region;
}

SharedRegion::~SharedRegion() {
  if (data_ != nullptr) munmap(data_, bytes_);
  if (connection_ >= 0) close(connection_);
}

uint64_t SharedRegion::room_of(uint64_t bytes) { return (bytes + kPageBytes - 1) / kPageBytes * kPageBytes; }

SharedRegion::Area SharedRegion::take(uint64_t bytes) {
  if (bytes == 0 || bytes > bytes_) return {};
  const absl::MutexLock lock(&mutex_);
  uint64_t at = 0;
  for (const auto& [offset, end] : taken_) {
    if (offset - at >= bytes) break;
    at = end;
  }
  if (at > bytes_ || bytes_ - at < bytes) return {};
  taken_[at] = at + room_of(bytes);
  populate(at + bytes);
  const auto give_back = [region = shared_from_this(), at](const std::byte*) {
    const absl::MutexLock again(&region->mutex_);
    region->taken_.erase(at);
  };
  return {.bytes = {data_ + at, give_back}, .size = bytes, .offset = at};
}

// Areas are taken from the start, so what no frame needs takes no memory. The pages are here before the
// server writes them, or its control group would pay.
void SharedRegion::populate(uint64_t end) {
  const uint64_t whole = std::min(room_of(end), bytes_);
  if (whole <= populated_) return;
  if (madvise(data_ + populated_, whole - populated_, MADV_POPULATE_WRITE) != 0) {
    // Linux before 5.14: each page is written.
    for (uint64_t at = populated_; at < whole; at += kPageBytes) data_[at] = std::byte{0};
  }
  populated_ = room_of(end);
}

std::optional<uint64_t> SharedRegion::offset_of(std::span<const std::byte> bytes) const {
  const auto begin = reinterpret_cast<uintptr_t>(data_);
  const auto at = reinterpret_cast<uintptr_t>(bytes.data());
  if (bytes.empty() || at < begin || at - begin > bytes_ || bytes_ - (at - begin) < bytes.size()) {
    return std::nullopt;
  }
  if ((at - begin) % v1::kMemoryAlignment != 0) return std::nullopt;
  return at - begin;
}

namespace {

// A frame that is being filled, and one that waits to be submitted, beside those in flight.
constexpr uint64_t kFramesAhead = 2;

// "" if it is no unix socket.
std::string path_of(absl::string_view address) {
  if (!absl::ConsumePrefix(&address, "unix:")) return "";
  if (absl::StartsWith(address, "//")) address.remove_prefix(2);
  return std::string(address);
}

}  // namespace

void SessionMemory::begin_call(const std::string& address) {
  std::shared_ptr<SharedRegion> last;  // goes without the lock
  const absl::MutexLock lock(&mutex_);
  last = std::move(region_);
  path_ = allowed_ ? path_of(address) : "";
  ++calls_;
}

void SessionMemory::give_up() {
  const absl::MutexLock lock(&mutex_);
  allowed_ = false;
}

SharedRegion::Area SessionMemory::area(uint64_t bytes, uint64_t image_bytes, uint32_t window) {
  std::shared_ptr<SharedRegion> now = region();
  if (now == nullptr || now->bytes() < SharedRegion::room_of(bytes) + SharedRegion::room_of(image_bytes)) {
    make(bytes, image_bytes, window);
    now = region();
  }
  return now == nullptr ? SharedRegion::Area() : now->take(bytes);
}

// If two threads need a region, the first one makes it, and the second one's frame goes in bands.
void SessionMemory::make(uint64_t bytes, uint64_t image_bytes, uint32_t window) {
  std::string path;
  uint64_t call = 0;
  {
    const absl::MutexLock lock(&mutex_);
    if (path_.empty() || making_) return;
    making_ = true;
    path = path_;
    call = calls_;
  }
  // Images: those in flight, as many results that wait, and one that is looked at.
  const uint64_t wanted = (window + kFramesAhead) * SharedRegion::room_of(bytes) +
                          (2 * uint64_t{window} + 1) * SharedRegion::room_of(image_bytes);
  absl::StatusOr<std::shared_ptr<SharedRegion>> made = SharedRegion::create(path, wanted);
  std::shared_ptr<SharedRegion> last;
  const absl::MutexLock lock(&mutex_);
  making_ = false;
  if (call != calls_) return;
  if (made.ok()) {
    last = std::exchange(region_, *std::move(made));
  } else {
    path_.clear();
  }
}

std::shared_ptr<SharedRegion> SessionMemory::region() const {
  const absl::MutexLock lock(&mutex_);
  return region_;
}

absl::Status SessionMemory::check() const {
  std::string path;
  {
    const absl::MutexLock lock(&mutex_);
    path = path_;
  }
  if (path.empty()) {
    return absl::InvalidArgumentError(
        "memory can be shared with a server at unix:PATH only; use the transport auto or grpc");
  }
  return SharedRegion::create(path, 1).status();
}

}  // namespace candela
