#include "server/render/reference/row_parts.h"

#include <algorithm>
#include <thread>
#include <vector>

#include "server/base/cgroup.h"

namespace candela {

uint32_t row_parts(uint32_t height) {
  static const uint32_t cpus = usable_cpus();  // it reads files
  return std::clamp<uint32_t>(cpus, 1, height);
}

void for_row_parts(uint32_t height, uint32_t parts,
                   const std::function<void(uint32_t first, uint32_t last, uint32_t part)>& work) {
  std::vector<std::jthread> threads;
  for (uint32_t i = 0; i < parts; ++i) {
    const auto first = static_cast<uint32_t>(uint64_t{height} * i / parts);
    const auto last = static_cast<uint32_t>(uint64_t{height} * (i + 1) / parts);
    threads.emplace_back([&work, first, last, i] { work(first, last, i); });
  }
}

}  // namespace candela
