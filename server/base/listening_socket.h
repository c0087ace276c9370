// A socket that listens on one address of the server.
#pragma once

#include <sys/socket.h>

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace candela {

// Owns its descriptor, and the file of a unix socket, which it removes. Non-blocking, and not inherited by
// other programs.
class ListeningSocket {
 public:
  // Listens on "HOST:PORT" or "unix:PATH": one socket, or one for each address of a name. 0.0.0.0 and [::]
  // take IPv4 and IPv6, as gRPC does. The socket of a process that has ended is replaced. The error is
  // UNAVAILABLE, is one line and names `option`.
  static absl::StatusOr<std::vector<ListeningSocket>> listen(absl::string_view option,
                                                             const std::string& address);

  ~ListeningSocket();
  ListeningSocket(ListeningSocket&& other) noexcept;
  ListeningSocket& operator=(ListeningSocket&&) = delete;

  int descriptor() const { return descriptor_; }
  // As given, but with the port that was picked for port 0.
  const std::string& address() const { return address_; }
  // The address at which this machine reaches it: loopback, if it listens on every address.
  const sockaddr_storage& local() const { return local_; }

 private:
  ListeningSocket(int descriptor, const std::string& address, std::string file);

  int descriptor_;
  std::string address_;
  std::string file_;  // of a unix socket
  sockaddr_storage local_{};
};

}  // namespace candela
