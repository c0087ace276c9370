#include "tests/service/memory/raw_region.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

namespace candela::testing {

int make_memfd(uint64_t bytes, int seals, unsigned flags) {
  const int descriptor = memfd_create("test", MFD_CLOEXEC | MFD_ALLOW_SEALING | flags);
  if (descriptor >= 0 && ftruncate(descriptor, static_cast<off_t>(bytes)) == 0) {
    fcntl(descriptor, F_ADD_SEALS, seals);
  }
  return descriptor;
}

int all_seals() { return F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL; }

MemoryClient::MemoryClient(const std::string& path)
    : socket_(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::memcpy(to.sun_path, path.data(), path.size());
  if (connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) close();
}

MemoryClient::~MemoryClient() { close(); }

void MemoryClient::close() {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

bool MemoryClient::send(const std::string& bytes, const std::vector<int>& descriptors) {
  std::string data = bytes;
  iovec part{data.data(), data.size()};
  std::vector<char> control(CMSG_SPACE(descriptors.size() * sizeof(int)));
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  if (!descriptors.empty()) {
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    cmsghdr* const header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(descriptors.size() * sizeof(int));
    std::memcpy(CMSG_DATA(header), descriptors.data(), descriptors.size() * sizeof(int));
  }
  return sendmsg(socket_, &message, MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
}

std::string MemoryClient::answer() {
  std::string bytes(300, '\0');
  const ssize_t size = recv(socket_, bytes.data(), bytes.size(), 0);
  bytes.resize(size > 0 ? static_cast<size_t>(size) : 0);
  return bytes;
}

size_t open_descriptors() {
  const std::filesystem::directory_iterator all("/proc/self/fd");
  return static_cast<size_t>(std::distance(begin(all), end(all)));
}

size_t memfds_mapped() {
  std::ifstream maps("/proc/self/maps");
  size_t count = 0;
  for (std::string line; std::getline(maps, line);) {
    if (line.find("/memfd:test") != std::string::npos || line.find("/memfd:candela") != std::string::npos)
      ++count;
  }
  return count;
}

}  // namespace candela::testing
