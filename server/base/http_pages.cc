#include "server/base/http_pages.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMaxRequestBytes = 8 << 10;
constexpr absl::Duration kRequestPatience =
    absl::Seconds(5);  // with one client, from its first byte to the last
constexpr int kWithoutDescriptorMs = 50;

const char* words_of(int status) {
  switch (status) {
    case 200:
      return "200 OK";
    case 400:
      return "400 Bad Request";
    case 404:
      return "404 Not Found";
    case 405:
      return "405 Method Not Allowed";
    default:
      return "503 Service Unavailable";
  }
}

}  // namespace

// Goes through these states, and may end in any of them: reading the request, writing the answer, waiting for
// the client to close. The last keeps the kernel from discarding an answer that is not yet read.
class HttpPages::Connection {
 public:
  Connection(int descriptor, absl::Time now) : descriptor_(descriptor), begun_(now) {}
  ~Connection() { close(descriptor_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  pollfd wanted() const { return {descriptor_, static_cast<int16_t>(answer_.empty() ? POLLIN : POLLOUT), 0}; }
  bool is_late(absl::Time now) const { return now > begun_ + kRequestPatience; }

  // Goes as far as it can without waiting. Returns false if the connection is over.
  bool proceed(const HttpPages& pages) {
    if (!answer_.empty()) return write_on();
    char bytes[4096];
    const ssize_t count = recv(descriptor_, bytes, sizeof bytes, MSG_DONTWAIT);
    if (count < 0) return errno == EAGAIN || errno == EINTR;
    if (count == 0) return false;
    if (answered_) return true;  // what follows the request is discarded
    request_.append(bytes, static_cast<size_t>(count));
    if (request_.size() > kMaxRequestBytes) return false;
    if (!absl::StrContains(request_, "\r\n\r\n") && !absl::StrContains(request_, "\n\n")) return true;
    answered_ = true;
    answer_ = pages.answer_to(request_);
    return write_on();
  }

 private:
  bool write_on() {
    const ssize_t count = send(descriptor_, answer_.data(), answer_.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    if (count < 0) return errno == EAGAIN || errno == EINTR;
    answer_.erase(0, static_cast<size_t>(count));
    if (answer_.empty()) shutdown(descriptor_, SHUT_WR);
    return true;
  }

  const int descriptor_;
  const absl::Time begun_;
  std::string request_;
  std::string answer_;  // the part that is not yet sent
  bool answered_ = false;
};

absl::StatusOr<std::unique_ptr<HttpPages>> HttpPages::start(const std::string& address,
                                                            size_t max_connections, Clock& clock,
                                                            Pages pages) {
  ASSIGN_OR_RETURN(std::vector<ListeningSocket> sockets, ListeningSocket::listen("metrics", address));
  return std::unique_ptr<HttpPages>(
      new HttpPages(std::move(sockets), max_connections, clock, std::move(pages)));
}

HttpPages::HttpPages(std::vector<ListeningSocket> sockets, size_t max_connections, Clock& clock, Pages pages)
    : sockets_(std::move(sockets)),
      max_connections_(std::max<size_t>(1, max_connections)),
      clock_(clock),
      pages_(std::move(pages)),
      stop_(eventfd(0, EFD_CLOEXEC)),
      thread_([this] { run(); }) {}

HttpPages::~HttpPages() {
  eventfd_write(stop_, 1);
  thread_.join();
  close(stop_);
}

void HttpPages::run() {
  for (;;) {
    std::vector<pollfd> waits;
    for (const auto& connection : connections_) waits.push_back(connection->wanted());
    for (const ListeningSocket& socket : sockets_) waits.push_back({socket.descriptor(), POLLIN, 0});
    waits.push_back({stop_, POLLIN, 0});
    poll(waits.data(), waits.size(), connections_.empty() ? -1 : 1000);
    if (waits.back().revents != 0) return;
    const absl::Time now = clock_.now();
    const size_t old = connections_.size();
    std::vector<std::unique_ptr<Connection>> going;
    for (size_t i = 0; i < old; ++i) {
      if (connections_[i]->is_late(now)) continue;
      if (waits[i].revents != 0 && !connections_[i]->proceed(*this)) continue;
      going.push_back(std::move(connections_[i]));
    }
    connections_ = std::move(going);
    for (size_t i = old; i + 1 < waits.size(); ++i) {
      if (waits[i].revents != 0) accept_from(waits[i].fd);
    }
  }
}

void HttpPages::accept_from(int socket) {
  const int descriptor = accept4(socket, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (descriptor >= 0) {
    if (connections_.size() >= max_connections_) connections_.erase(connections_.begin());
    connections_.push_back(std::make_unique<Connection>(descriptor, clock_.now()));
  } else if (errno == EMFILE || errno == ENFILE) {
    // The oldest makes room, or another part of the process will.
    if (!connections_.empty()) {
      connections_.erase(connections_.begin());
    } else {
      poll(nullptr, 0, kWithoutDescriptorMs);
    }
  }
}

std::string HttpPages::answer_to(const std::string& request) const {
  const std::vector<absl::string_view> words =
      absl::StrSplit(absl::string_view(request).substr(0, request.find_first_of("\r\n")), ' ');
  Answer answer;
  if (words.size() != 3 || !absl::StartsWith(words[2], "HTTP/1.")) {
    answer = {400, "this is not HTTP\n"};
  } else if (words[0] != "GET") {
    answer = {405, "only GET is known\n"};
  } else {
    const auto page = pages_.find(std::string(words[1].substr(0, words[1].find('?'))));
    answer = page == pages_.end() ? Answer{404, "there is no such page\n"} : page->second();
  }
  return absl::StrFormat(
      "HTTP/1.1 %s\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\nContent-Length: %d\r\n"
      "Connection: close\r\n\r\n%s",
      words_of(answer.status), answer.text.size(), answer.text);
}

}  // namespace candela
