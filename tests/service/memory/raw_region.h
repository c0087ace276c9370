// A client of the `.memory` socket that the test controls step by step.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace candela::testing {

// A memfd of `bytes`, with these seals. The caller closes it.
int make_memfd(uint64_t bytes, int seals, unsigned flags = 0);
int all_seals();

// A connection to `path`; not open if nobody listens there. Closes it at the end.
class MemoryClient {
 public:
  explicit MemoryClient(const std::string& path);
  ~MemoryClient();
  MemoryClient(const MemoryClient&) = delete;
  MemoryClient& operator=(const MemoryClient&) = delete;

  // Sends these bytes with these descriptors. Returns whether it could.
  bool send(const std::string& bytes, const std::vector<int>& descriptors);
  // Waits for the answer; "" if the server closed.
  std::string answer();
  // Waits until the server has closed.
  bool closed() { return answer().empty(); }
  void close();

 private:
  int socket_ = -1;
};

// What this process has: its descriptors, and its mappings of memfds.
size_t open_descriptors();
size_t memfds_mapped();

}  // namespace candela::testing
