// host_bits FILE: renders every case with the host's executor, once for each instruction set that this
// processor has, and compares the bits with those that FILE has. --record FILE writes them. Exits with 77 if
// no kernel runs on this processor.
#include "server/render/host/targets.h"
// Only after targets.h.
#include <hwy/highway.h>
#include <hwy/targets.h>

#include <cstdio>
#include <cstring>
#include <fstream>
#include <map>

#include "tests/bits/bits.h"

namespace candela::testing {
namespace {

using Lines = std::map<std::string, std::string>;  // hashes by name

Lines render_all() {
  Bench bench(2);
  Lines lines;
  for (const auto& cases : {frame_cases(), exposure_cases(), view_cases()}) {
    for (const Case& one : cases) {
      const Bits bits = one.render(bench);
      char hashes[40];
      std::snprintf(hashes, sizeof hashes, "%016llx %016llx",
                    static_cast<unsigned long long>(bits.pixels.value()),
                    static_cast<unsigned long long>(bits.numbers.value()));
      if (!lines.emplace(one.name, hashes).second) {
        std::fprintf(stderr, "two cases are called %s\n", one.name.c_str());
        std::exit(2);
      }
    }
  }
  return lines;
}

Lines read(const char* path) {
  std::ifstream file(path);
  Lines lines;
  for (std::string pixels, numbers, name; file >> pixels >> numbers >> std::ws && std::getline(file, name);)
    lines[name] = pixels + ' ' + numbers;
  return lines;
}

// Prints the cases that differ. Returns how many do.
size_t differences(const Lines& recorded, const Lines& rendered) {
  size_t count = 0;
  for (const auto& [name, hashes] : rendered) {
    const auto found = recorded.find(name);
    if (found != recorded.end() && found->second == hashes) continue;
    ++count;
    if (found == recorded.end()) {
      std::printf("  not recorded: %s\n", name.c_str());
      continue;
    }
    const bool pixels = found->second.compare(0, 16, hashes, 0, 16) != 0;
    const bool numbers = found->second.compare(17, 16, hashes, 17, 16) != 0;
    std::printf("  other %s: %s\n",
                !numbers ? "pixels"
                : pixels ? "pixels and numbers"
                         : "numbers",
                name.c_str());
  }
  for (const auto& [name, hashes] : recorded) {
    if (rendered.count(name) != 0) continue;
    ++count;
    std::printf("  not rendered: %s\n", name.c_str());
  }
  return count;
}

int run(const char* path, bool record) {
  const int64_t all = hwy::SupportedTargets() & HWY_TARGETS & (HWY_AVX2 | HWY_AVX3 | HWY_NEON);
  if (all == 0) {
    std::printf("SKIPPED: this processor has no vectors with fused multiply-add\n");
    return 77;
  }
  Lines recorded = read(path);
  bool same = true;
  for (int64_t rest = all; rest != 0; rest &= rest - 1) {
    const int64_t target = rest & -rest;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(target);
    const Lines rendered = render_all();
    if (record && rest == all) {
      std::ofstream file(path);
      for (const auto& [name, hashes] : rendered) file << hashes << ' ' << name << '\n';
      recorded = rendered;
    }
    std::printf("%s: %zu cases\n", hwy::TargetName(target), rendered.size());
    const size_t differing = differences(recorded, rendered);
    if (differing != 0) std::printf("%s: %zu cases differ\n", hwy::TargetName(target), differing);
    same = same && differing == 0;
  }
  return same ? 0 : 1;
}

}  // namespace
}  // namespace candela::testing

int main(int argc, char** argv) {
  const bool record = argc == 3 && std::strcmp(argv[1], "--record") == 0;
  if (argc != 2 && !record) {
    std::fprintf(stderr, "usage: host_bits [--record] FILE\n");
    return 2;
  }
  return candela::testing::run(argv[argc - 1], record);
}
