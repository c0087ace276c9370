// A small HTTP server for a few pages of text, for probes and Prometheus.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"
#include "server/base/clock.h"
#include "server/base/listening_socket.h"

namespace candela {

// One thread answers GET requests for fixed paths and closes each connection after its answer. It never waits
// for a client: one that is slow has five seconds, and if there are too many connections, the oldest ends. So
// slow clients, however many, keep nobody from an answer.
class HttpPages {
 public:
  struct Answer {
    int status = 200;
    std::string text;
  };
  using Pages = std::map<std::string, std::function<Answer()>>;  // by path, such as "/metrics"

  // Listens on "HOST:PORT". `max_connections` is at least 1. `clock` outlives it. Fails as
  // ListeningSocket::listen does.
  static absl::StatusOr<std::unique_ptr<HttpPages>> start(const std::string& address, size_t max_connections,
                                                          Clock& clock, Pages pages);
  ~HttpPages();
  HttpPages(const HttpPages&) = delete;
  HttpPages& operator=(const HttpPages&) = delete;

  // With the port that was picked.
  const std::string& address() const { return sockets_.front().address(); }

 private:
  class Connection;

  HttpPages(std::vector<ListeningSocket> sockets, size_t max_connections, Clock& clock, Pages pages);
  void run();
  void accept_from(int socket);
  std::string answer_to(const std::string& request) const;

  const std::vector<ListeningSocket> sockets_;
  const size_t max_connections_;
  Clock& clock_;
  const Pages pages_;
  std::vector<std::unique_ptr<Connection>> connections_;  // the oldest first; the thread's
  const int stop_;                                        // becomes readable when the thread shall end
  std::thread thread_;                                    // last: it uses all of the above
};

}  // namespace candela
