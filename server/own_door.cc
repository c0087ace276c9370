#include "server/own_door.h"

#include <netinet/in.h>
#include <poll.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/string_view.h"

namespace candela {
namespace {

// The client's preface of HTTP/2 and an empty SETTINGS frame (RFC 9113, 3.4).
constexpr absl::string_view kPreface{"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\4\0\0\0\0\0", 33};

constexpr int kStepMs = 20;  // between looks at the end of the thread

socklen_t size_of(const sockaddr_storage& address) {
  return address.ss_family == AF_UNIX   ? sizeof(sockaddr_un)
         : address.ss_family == AF_INET ? sizeof(sockaddr_in)
                                        : sizeof(sockaddr_in6);
}

}  // namespace

OwnDoor::OwnDoor(std::vector<Address> addresses, Clock& clock, const Options& options,
                 std::function<void(State)> report)
    : addresses_(std::move(addresses)),
      clock_(clock),
      options_(options),
      report_(std::move(report)),
      tls_(SSL_CTX_new(TLS_client_method()), SSL_CTX_free),
      stop_(clock),
      thread_([this] { run(); }) {}

OwnDoor::~OwnDoor() {
  stop_.give();
  thread_.join();
}

void OwnDoor::run() {
  State told;
  absl::Duration deaf_for = absl::ZeroDuration();
  while (!stop_.comes_within(options_.interval)) {
    const absl::Time begin = clock_.now();
    bool all = true;
    for (const Address& address : addresses_) all = all && answers(address);
    const absl::Duration waited =
        std::min(clock_.now() - begin, options_.interval * static_cast<double>(addresses_.size()));
    deaf_for = all ? absl::ZeroDuration() : deaf_for + options_.interval + waited;
    const State state{deaf_for < options_.limit, deaf_for < options_.dead_limit};
    if (state != told && !stop_.is_given()) report_(told = state);
  }
}

bool OwnDoor::answers(const Address& address) {
  const absl::Time end = clock_.now() + options_.interval;
  const int connection = socket(address.at.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (connection < 0) return false;
  const absl::Cleanup close_it = [connection] { close(connection); };
  if (connect(connection, reinterpret_cast<const sockaddr*>(&address.at), size_of(address.at)) != 0) {
    if (errno != EINPROGRESS || !wait_for(connection, POLLOUT, end)) return false;
    int error = 0;
    socklen_t size = sizeof error;
    getsockopt(connection, SOL_SOCKET, SO_ERROR, &error, &size);
    if (error != 0) return false;
  }
  if (address.tls && tls_ != nullptr) {
    const std::unique_ptr<SSL, decltype(&SSL_free)> client(SSL_new(tls_.get()), SSL_free);
    if (client == nullptr || SSL_set_fd(client.get(), connection) != 1) return false;
    SSL_connect(client.get());  // sends its first message
  } else if (send(connection, kPreface.data(), kPreface.size(), MSG_NOSIGNAL) < 0) {
    return errno == ECONNRESET || errno == EPIPE;  // closed without an answer
  }
  return wait_for(connection, POLLIN, end);
}

bool OwnDoor::wait_for(int connection, int16_t events, absl::Time end) {
  while (clock_.now() < end && !stop_.is_given()) {
    pollfd wait{connection, events, 0};
    const int ready = poll(&wait, 1, kStepMs);
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
  }
  return false;
}

}  // namespace candela
