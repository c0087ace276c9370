#include "server/session/memory_door.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/candela/v1/limits.h"
#include "server/base/log.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr char kVersion = 1;
// More than one is refused. The kernel closes those beyond.
constexpr size_t kDescriptorsTaken = 4;

// What one message of a client brought. Owns the descriptors.
struct Hello {
  ~Hello() {
    for (const int descriptor : descriptors) close(descriptor);
  }
  std::array<char, 2> bytes{};
  ssize_t size = 0;  // 0: the client has gone
  std::vector<int> descriptors{};
};

// Nothing if no message is there.
std::unique_ptr<Hello> receive(int connection) {
  auto hello = std::make_unique<Hello>();
  iovec part{hello->bytes.data(), hello->bytes.size()};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(kDescriptorsTaken * sizeof(int))> control{};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  hello->size = recvmsg(connection, &message, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
  if (hello->size < 0 && (errno == EAGAIN || errno == EINTR)) return nullptr;
  if (hello->size < 0) {
    hello->size = 0;
    return hello;
  }
  for (cmsghdr* header = CMSG_FIRSTHDR(&message); header != nullptr; header = CMSG_NXTHDR(&message, header)) {
    if (header->cmsg_level != SOL_SOCKET || header->cmsg_type != SCM_RIGHTS) continue;
    const size_t count = (header->cmsg_len - CMSG_LEN(0)) / sizeof(int);
    for (size_t i = 0; i < count; ++i) {
      int descriptor = -1;
      std::memcpy(&descriptor, CMSG_DATA(header) + i * sizeof descriptor, sizeof descriptor);
      hello->descriptors.push_back(descriptor);
    }
  }
  return hello;
}

// The socket of a new connection has room for it. A client that is gone is noticed later.
void reply(int connection, char first, absl::string_view rest) {
  std::string bytes(1, first);
  absl::StrAppend(&bytes, rest.substr(0, v1::kMaxMemoryReplyBytes - 1));
  send(connection, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
}

ucred peer_of(int connection) {
  ucred peer{};
  socklen_t size = sizeof peer;
  getsockopt(connection, SOL_SOCKET, SO_PEERCRED, &peer, &size);
  return peer;
}

absl::StatusOr<std::shared_ptr<MemoryRegion>> region_of(const Hello& hello,
                                                        const MemoryRegion::Claim& claim) {
  if (hello.size != 1 || hello.bytes[0] != kVersion || hello.descriptors.size() != 1) {
    return absl::InvalidArgumentError(
        "a region is registered by one byte of the value 1 together with one descriptor (docs/transport.md)");
  }
  return MemoryRegion::map(hello.descriptors.front(), claim);
}

}  // namespace

struct MemoryDoor::Wake {
  Wake() : event(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}
  ~Wake() { close(event); }
  void wake() const { eventfd_write(event, 1); }

  const int event;
  absl::Mutex mutex;
  std::vector<int> accepted ABSL_GUARDED_BY(mutex);
  std::vector<std::shared_ptr<bool>> late ABSL_GUARDED_BY(mutex);
  size_t connections ABSL_GUARDED_BY(mutex) = 0;
  bool stop ABSL_GUARDED_BY(mutex) = false;
};

MemoryDoor::MemoryDoor(MemoryRegions& regions, Timers& timers, const Options& options,
                       MemoryRegion::Claim claim)
    : regions_(regions),
      timers_(timers),
      options_(options),
      claim_(std::move(claim)),
      wake_(std::make_shared<Wake>()),
      thread_([this] { run(); }) {}

MemoryDoor::~MemoryDoor() {
  {
    const absl::MutexLock lock(&wake_->mutex);
    wake_->stop = true;
  }
  wake_->wake();
  thread_.join();
}

void MemoryDoor::take(int descriptor) {
  {
    const absl::MutexLock lock(&wake_->mutex);
    if (!wake_->stop && wake_->connections < options_.max_connections) {
      ++wake_->connections;
      wake_->accepted.push_back(descriptor);
      descriptor = -1;
    }
  }
  wake_->wake();
  if (descriptor < 0) return;
  reply(descriptor, static_cast<char>(absl::StatusCode::kUnavailable),
        "as many regions are registered as sessions and calls may run; send bands");
  close(descriptor);
}

size_t MemoryDoor::connections() const {
  const absl::MutexLock lock(&wake_->mutex);
  return wake_->connections;
}

void MemoryDoor::run() {
  for (;;) {
    std::vector<pollfd> waits = {{wake_->event, POLLIN, 0}};
    for (const auto& [descriptor, connection] : open_) waits.push_back({descriptor, POLLIN, 0});
    if (poll(waits.data(), waits.size(), -1) < 0) continue;
    for (size_t i = 1; i < waits.size(); ++i) {
      if (waits[i].revents != 0 && !serve(waits[i].fd, open_.at(waits[i].fd))) end(waits[i].fd);
    }
    if (waits.front().revents == 0) continue;
    eventfd_t count = 0;
    eventfd_read(wake_->event, &count);
    admit();
    const absl::MutexLock lock(&wake_->mutex);
    if (wake_->stop) break;
  }
  admit();  // what was accepted since, to close it
  while (!open_.empty()) end(open_.begin()->first);
}

// Takes over what was accepted, and closes those that are late.
void MemoryDoor::admit() {
  std::vector<int> accepted;
  std::vector<std::shared_ptr<bool>> late;
  {
    const absl::MutexLock lock(&wake_->mutex);
    accepted.swap(wake_->accepted);
    late.swap(wake_->late);
  }
  for (const std::shared_ptr<bool>& one : late) *one = true;
  std::vector<int> ending;
  for (const auto& [descriptor, connection] : open_) {
    if (*connection.late && connection.ticket.empty()) ending.push_back(descriptor);
  }
  for (const int descriptor : ending) end(descriptor);
  for (const int descriptor : accepted) {
    Connection& connection = open_[descriptor];
    connection.late = std::make_shared<bool>(false);
    connection.timer = timers_.call_after(options_.hello_limit, [wake = wake_, late = connection.late] {
      {
        const absl::MutexLock lock(&wake->mutex);
        wake->late.push_back(late);
      }
      wake->wake();
    });
  }
}

bool MemoryDoor::serve(int descriptor, Connection& connection) {
  const std::unique_ptr<Hello> hello = receive(descriptor);
  if (hello == nullptr) return true;
  if (hello->size == 0 || !connection.ticket.empty()) return false;
  absl::StatusOr<std::shared_ptr<MemoryRegion>> region = region_of(*hello, claim_);
  const uint64_t bytes = region.ok() ? (*region)->bytes() : 0;
  absl::StatusOr<std::string> ticket =
      region.ok() ? regions_.add(*std::move(region)) : absl::StatusOr<std::string>(region.status());
  const ucred peer = peer_of(descriptor);
  log_event(LogLevel::kInfo, ticket.ok() ? "memory region registered" : "memory region refused",
            {{"pid", int64_t{peer.pid}},
             {"uid", uint64_t{peer.uid}},
             {"bytes", bytes},
             {"message", ticket.status().message()}});
  if (!ticket.ok()) {
    reply(descriptor, static_cast<char>(ticket.status().code()), ticket.status().message());
    return false;
  }
  connection.ticket = *std::move(ticket);
  connection.timer.reset();
  reply(descriptor, 0, connection.ticket);
  return true;
}

void MemoryDoor::end(int descriptor) {
  if (const std::string ticket = std::move(open_.at(descriptor).ticket); !ticket.empty()) {
    regions_.remove(ticket);
  }
  open_.erase(descriptor);
  close(descriptor);
  const absl::MutexLock lock(&wake_->mutex);
  --wake_->connections;
}

}  // namespace candela
