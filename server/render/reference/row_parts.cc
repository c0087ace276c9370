#include "server/render/reference/row_parts.h"

#include <algorithm>
#include <chrono>
#include <system_error>
#include <thread>
#include <vector>

#include "server/base/process.h"
#include "server/base/slices.h"

namespace candela {
namespace {

// The costliest curve takes some microseconds a texel, so this takes a few milliseconds.
constexpr uint32_t kSpan = 1024;

// The spans of some rows that are left to do.
struct Part {
  uint64_t next;
  uint64_t last;
};

}  // namespace

uint32_t row_parts(uint32_t height) {
  static const uint32_t cpus = usable_cpus();  // it reads files
  return std::clamp<uint32_t>(cpus, 1, height);
}

void for_row_parts(uint32_t width, uint32_t height, uint32_t parts,
                   const std::function<void(const RowSpan& span, uint32_t part)>& work) {
  const uint64_t spans_a_row = (uint64_t{width} + kSpan - 1) / kSpan;
  std::vector<Part> spans_left;
  for (uint64_t i = 0; i < parts; ++i) {
    spans_left.push_back({spans_a_row * (height * i / parts), spans_a_row * (height * (i + 1) / parts)});
  }
  const auto run = [&](uint32_t i, std::chrono::steady_clock::time_point end) {
    Part& part = spans_left[i];
    do {
      const auto y = static_cast<uint32_t>(part.next / spans_a_row);
      const auto first = static_cast<uint32_t>(part.next % spans_a_row) * kSpan;
      work({y, first, std::min(first + kSpan, width)}, i);
      ++part.next;
    } while (part.next < part.last && std::chrono::steady_clock::now() < end);
  };
  const auto left = [](const Part& part) { return part.next < part.last; };
  while (std::any_of(spans_left.begin(), spans_left.end(), left)) {
    checkpoint();
    std::vector<std::jthread> threads;
    for (uint32_t i = 0; i < parts; ++i) {
      if (!left(spans_left[i])) continue;
      try {
        threads.emplace_back(run, i, slice_end());
      } catch (const std::system_error&) {  // the system gives no more threads
        run(i, slice_end());
        break;  // one part takes the slice
      }
    }
  }
}

}  // namespace candela
