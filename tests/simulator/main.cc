// Runs histories, and judges each.
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <string_view>

#include "tests/simulator/history.h"

namespace candela::testing {
namespace {

constexpr char kUsage[] =
    "usage: candela_simulator [--histories N] [--seed S]   runs N histories (20000) of the seeds S, S + 1, "
    "...\n"
    "       candela_simulator --replay SEED                runs one, and prints its events\n"
    "       candela_simulator --list-faults                prints what can happen in them\n";

int list_faults() {
  for (const auto& [name, what] : all_faults()) std::printf("%-18s %s\n", name.c_str(), what.c_str());
  return 0;
}

void print_counts(const char* what, const std::map<std::string, uint64_t>& counts) {
  std::printf("%s:", what);
  for (const auto& [name, count] : counts)
    std::printf(" %s %llu", name.c_str(), static_cast<unsigned long long>(count));
  std::printf("\n");
}

int replay(uint64_t seed) {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);  // a failed CHECK ends the program
  const HistoryReport report = run_history(seed, /*log=*/true);
  print_counts("faults", report.struck);
  std::printf("%s\n", report.verdict.ok() ? "it is right" : std::string(report.verdict.message()).c_str());
  return report.verdict.ok() ? 0 : 1;
}

// The history that runs, for a failed CHECK, which ends the program.
const char* g_program = nullptr;
volatile uint64_t g_seed = 0;

void say_how_to_see_it() {
  std::printf("to see it: %s --replay %llu\n", g_program, static_cast<unsigned long long>(g_seed));
  std::fflush(stdout);
}

int run(uint64_t first, uint64_t count) {
  const auto begin = std::chrono::steady_clock::now();
  HistoryReport sum;
  for (uint64_t i = 0; i < count; ++i) {
    g_seed = first + i;
    const HistoryReport report = run_history(g_seed, /*log=*/false);
    if (!report.verdict.ok()) {
      std::printf("history %llu of %llu is wrong: %s\n", static_cast<unsigned long long>(i + 1),
                  static_cast<unsigned long long>(count), std::string(report.verdict.message()).c_str());
      say_how_to_see_it();
      return 1;
    }
    sum.lasted += report.lasted;
    sum.events += report.events;
    sum.frames += report.frames;
    sum.resumes += report.resumes;
    for (const auto& [name, times] : report.struck) sum.struck[name] += times;
    for (const auto& [name, times] : report.ends) sum.ends[name] += times;
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  std::printf("%llu histories are right: %.0f h, %llu events, %llu frames, %llu resumes, in %.1f s\n",
              static_cast<unsigned long long>(count), absl::ToDoubleHours(sum.lasted),
              static_cast<unsigned long long>(sum.events), static_cast<unsigned long long>(sum.frames),
              static_cast<unsigned long long>(sum.resumes), seconds);
  print_counts("faults", sum.struck);
  print_counts("ends of sessions", sum.ends);
  return 0;
}

int main(int argc, char** argv) {
  uint64_t histories = 20'000;
  uint64_t seed = 1;
  for (int i = 1; i < argc; ++i) {
    const std::string_view option = argv[i];
    if (option == "--list-faults") return list_faults();
    if (i + 1 == argc) return std::fputs(kUsage, stderr), 2;
    char* end = nullptr;
    const uint64_t value = std::strtoull(argv[++i], &end, 10);
    if (*end != '\0') return std::fputs(kUsage, stderr), 2;
    if (option == "--replay") return replay(value);
    if (option == "--histories") {
      histories = value;
    } else if (option == "--seed") {
      seed = value;
    } else {
      return std::fputs(kUsage, stderr), 2;
    }
  }
  g_program = argv[0];
  std::signal(SIGABRT, [](int) { say_how_to_see_it(); });
  return run(seed, histories);
}

}  // namespace
}  // namespace candela::testing

int main(int argc, char** argv) { return candela::testing::main(argc, argv); }
