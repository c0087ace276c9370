#include "server/accept_loop.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <optional>
#include <string>
#include <utility>

#include "server/access/client_identity.h"
#include "server/base/log.h"

namespace candela {
namespace {

constexpr int kWithoutDescriptorMs = 20;  // before the next attempt
constexpr int kAtATime = 64;              // connections of one door, before the next door's turn

int open_spare() { return open("/dev/null", O_RDONLY | O_CLOEXEC); }

const char* word(ConnectionRefusal reason) {
  return reason == ConnectionRefusal::kLimit ? "max-connections are open" : "no file descriptor is left";
}

}  // namespace

void OpenConnections::add(int descriptor, std::string client) {
  struct stat about {};
  if (fstat(descriptor, &about) != 0) return;
  const absl::MutexLock lock(&mutex_);
  // Doubling the limit keeps this cheap: a constant time for each connection on average.
  if (known_.size() >= look_at_) {
    forget_closed();
    look_at_ = std::max(look_at_, 2 * known_.size());
  }
  known_.push_back({descriptor, about.st_ino, std::move(client)});
}

size_t OpenConnections::count() {
  const absl::MutexLock lock(&mutex_);
  forget_closed();
  return known_.size();
}

bool OpenConnections::has(const std::string& client) const {
  const absl::MutexLock lock(&mutex_);
  return std::any_of(known_.begin(), known_.end(),
                     [&](const Known& known) { return known.client == client; });
}

std::set<std::string> OpenConnections::clients() {
  const absl::MutexLock lock(&mutex_);
  forget_closed();
  std::set<std::string> clients;
  for (const Known& known : known_) clients.insert(known.client);
  return clients;
}

void OpenConnections::forget_closed() {
  std::erase_if(known_, [](const Known& known) {
    struct stat about {};
    // Its number may have been used again, so the inode has to be the same.
    return fstat(known.descriptor, &about) != 0 || about.st_ino != known.inode || !S_ISSOCK(about.st_mode);
  });
}

AcceptLoop::AcceptLoop(std::vector<Door> doors, size_t max_connections, OpenConnections& connections,
                       Metrics& metrics, Clock& clock)
    : doors_(std::move(doors)),
      max_connections_(max_connections),
      connections_(connections),
      metrics_(metrics),
      clock_(clock),
      spare_(open_spare()),
      stop_(eventfd(0, EFD_CLOEXEC)),
      thread_([this] { run(); }) {}

AcceptLoop::~AcceptLoop() {
  eventfd_write(stop_, 1);
  thread_.join();
  close(stop_);
  if (spare_ >= 0) close(spare_);
}

void AcceptLoop::run() {
  std::vector<pollfd> waits;
  for (const Door& door : doors_) waits.push_back({door.socket.descriptor(), POLLIN, 0});
  waits.push_back({stop_, POLLIN, 0});
  for (;;) {
    if (poll(waits.data(), waits.size(), -1) < 0) continue;
    if (waits.back().revents != 0) return;
    for (size_t i = 0; i < doors_.size(); ++i) {
      for (int n = 0; waits[i].revents != 0 && n < kAtATime && accept_one(doors_[i]); ++n) {
      }
    }
  }
}

bool AcceptLoop::accept_one(const Door& door) {
  const int descriptor = accept4(door.socket.descriptor(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (descriptor >= 0) {
    if (is_full()) {
      refuse(descriptor, ConnectionRefusal::kLimit);
    } else {
      ++at_most_;
      connections_.add(descriptor);
      door.take(descriptor);
    }
    return true;
  }
  if (errno == EAGAIN) return false;
  if (errno == EMFILE || errno == ENFILE) {
    accept_without_descriptor(door);
  } else if (errno == ENOBUFS || errno == ENOMEM) {
    poll(nullptr, 0, kWithoutDescriptorMs);
  }
  return false;  // or the client has gone already
}

void AcceptLoop::accept_without_descriptor(const Door& door) {
  // Without this the connection would stay in the kernel's queue, and poll() would return at once for ever.
  if (spare_ >= 0) {
    close(std::exchange(spare_, -1));
    const int descriptor = accept4(door.socket.descriptor(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (descriptor >= 0) refuse(descriptor, ConnectionRefusal::kDescriptors);
  }
  spare_ = open_spare();
  // Another thread took the descriptor; without this wait the loop would spin until it gives one back.
  if (spare_ < 0) poll(nullptr, 0, kWithoutDescriptorMs);
}

void AcceptLoop::refuse(int descriptor, ConnectionRefusal reason) {
  metrics_.connection_refused(reason);
  if (const std::optional<uint64_t> connections = lines_.pass(clock_.now())) {
    log_event(LogLevel::kWarning, "connection refused",
              {{"reason", word(reason)},
               {"peer", client_of(descriptor)},
               {"connections", *connections},
               {"max_connections", uint64_t{max_connections_}}});
  }
  close(descriptor);
}

bool AcceptLoop::is_full() {
  // count() looks at every connection, so only if the estimate reaches the limit.
  if (at_most_ >= max_connections_) at_most_ = connections_.count();
  return at_most_ >= max_connections_;
}

}  // namespace candela
