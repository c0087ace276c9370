// Mixed traffic with faults for CANDELA_SOAK_SECONDS (30): nothing grows, and correct clients are served.
// Memory is measured in lulls, with nothing in flight. It is the resident memory after the allocator has
// returned what is free, without the texture pool, which may fill up to its budget. After 20 minutes or more,
// its slope must be below 1 MiB an hour, within three errors of the fitted line, and that error must be small
// enough to see a leak of 46 MiB an hour.
#include <malloc.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <random>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/figures.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

absl::Duration soak_time() {
  const char* seconds = std::getenv("CANDELA_SOAK_SECONDS");
  return absl::Seconds(seconds != nullptr ? std::atoi(seconds) : 30);
}

// Runs clients one after the other, each with different behaviour. The same seed gives the same clients. Each
// holds `lull` as a reader, so there is no client while another thread holds it as a writer. If it `leaks`,
// each client leaves kSlower MiB, a descriptor and a thread behind.
class Traffic {
 public:
  Traffic(const std::string& address, uint32_t seed, absl::Mutex& lull, bool leaks)
      : address_(address), seed_(seed), leaks_(leaks), random_(seed), lull_(lull) {
    for (const uint32_t width : {33u, 160u, 320u, 640u}) frames_.push_back(natural(width, width * 3 / 4));
  }

  ~Traffic() {
    end_.Notify();
    for (Leak& leak : leaks_so_far_) {
      close(leak.descriptor);
      leak.thread.join();
    }
  }

  void run_until(absl::Time end) {
    for (uint64_t i = 0; absl::Now() < end; ++i) {
      absl::ReaderMutexLock client(&lull_);
      one(absl::StrCat("soak-", seed_, "-", i));
      if (!leaks_) continue;
      leaks_so_far_.push_back({std::string(kSlower << 20, 'x'), dup(STDERR_FILENO),
                               std::thread([this] { end_.WaitForNotification(); })});
    }
  }
  uint64_t served() const { return served_; }
  uint64_t cut_short() const { return cut_short_; }

 private:
  uint32_t below(uint32_t n) { return std::uniform_int_distribution<uint32_t>(0, n - 1)(random_); }
  const WireFrame& frame() { return frames_[below(4)]; }

  void one(const std::string& name) {
    switch (below(8)) {
      case 0:
        return render();
      case 1:
      case 2:
        return session(name, {});
      case 3: {
        v1::StreamOpen open;
        open.set_lookahead(2);
        open.set_encoding(v1::ENCODING_PNG);
        return session(name, open);
      }
      case 4:
        return cancelled(name);
      case 5:
        return disconnected(name);
      case 6:
        return refused(name);
      default:
        return unread(name);
    }
  }

  void render() {
    const absl::StatusOr<Connection> connection = Connection::open(address_);
    EXPECT_OK(connection->render({}, view(frame())));
    ++served_;
  }
  void session(const std::string& name, v1::StreamOpen open) {
    open.set_session(name);
    std::vector<WireFrame> frames;
    for (int i = 0; i < 6; ++i) frames.push_back(frame());
    EXPECT_EQ(stream_all(own_channel(address_), open, frames).size(), frames.size());
    ++served_;
  }
  void cancelled(const std::string& name) {
    StreamClient client(own_channel(address_));
    client.open(name);
    client.send(frame(), 0, 0);
    client.send_header(frame(), 1, 1);
    absl::SleepFor(absl::Milliseconds(below(10)));
    client.cancel();
    ++cut_short_;
  }
  void disconnected(const std::string& name) {
    WireCutter cutter(address_);
    StreamClient client(own_channel(cutter.address()));
    client.open(name);
    client.send(frame(), 0, 0);
    client.send_header(frame(), 1, 1);
    cutter.cut();
    EXPECT_FALSE(client.finish().ok());
    ++cut_short_;
  }
  void refused(const std::string& name) {
    StreamClient client(own_channel(address_));
    client.open(name);
    client.send_rows(frame(), 0, 1);
    EXPECT_EQ(client.finish().error_code(), grpc::INVALID_ARGUMENT);
    ++cut_short_;
  }
  void unread(const std::string& name) {
    StreamClient client(own_channel(address_), /*reads=*/false);
    client.open(name);
    client.send(frames_.back(), 0, 0);
    absl::SleepFor(absl::Milliseconds(below(100)));
    client.cancel();
    ++cut_short_;
  }

  struct Leak {
    std::string memory;
    int descriptor;
    std::thread thread;
  };

  const std::string address_;
  const uint32_t seed_;
  const bool leaks_;
  std::vector<Leak> leaks_so_far_;
  absl::Notification end_;
  std::mt19937 random_;
  absl::Mutex& lull_;
  std::vector<WireFrame> frames_;
  uint64_t served_ = 0;
  uint64_t cut_short_ = 0;
};

struct Reading {
  double seconds;
  double memory_mib;  // resident, without the pool
  double pool_mib;
  size_t descriptors;
  size_t threads;
};

size_t entries(const char* folder) {
  return static_cast<size_t>(std::distance(std::filesystem::directory_iterator(folder), {}));
}

Reading read_now(absl::Time begin, const Connection& connection) {
  const absl::StatusOr<v1::GetServerInfoResponse> info = connection.server_info();
  EXPECT_OK(info);
  const double pool = info.ok() ? static_cast<double>(info->pool().bytes_idle()) : 0;
  malloc_trim(0);
  size_t size = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> size >> resident;
  return {absl::ToDoubleSeconds(absl::Now() - begin),
          (static_cast<double>(resident) * 4096 - pool) / (1 << 20), pool / (1 << 20),
          entries("/proc/self/fd"), entries("/proc/self/task")};
}

// The slope of a least-squares line and its standard error, in MiB an hour.
std::pair<double, double> memory_slope(const std::vector<Reading>& readings) {
  const auto n = static_cast<double>(readings.size());
  double mean_t = 0, mean_m = 0;
  for (const Reading& r : readings) {
    mean_t += r.seconds / n;
    mean_m += r.memory_mib / n;
  }
  double tt = 0, tm = 0, rest = 0;
  for (const Reading& r : readings) {
    tt += (r.seconds - mean_t) * (r.seconds - mean_t);
    tm += (r.seconds - mean_t) * (r.memory_mib - mean_m);
  }
  const double slope = tm / tt;
  for (const Reading& r : readings) {
    const double residual = r.memory_mib - mean_m - slope * (r.seconds - mean_t);
    rest += residual * residual;
  }
  return {slope * 3600, std::sqrt(rest / (n - 2) / tt) * 3600};
}

// The largest standard error of the slope, in MiB an hour, with which a soak of 20 minutes counts.
constexpr double kMostError = 15;

struct Soak {
  std::vector<Reading> readings;  // without the first quarter
  uint64_t served = 0;
  uint64_t cut_short = 0;
};

// Three clients at a time for that long. Memory, descriptors and threads are read in 120 lulls.
Soak soak(absl::Duration time, bool leaks) {
  Config config = test_config();
  config.idle_timeout = absl::Seconds(20);
  config.max_sessions = 64;  // a session's slot may stay taken for a moment after its client saw the end
  const std::unique_ptr<Server> server = start_server(config);
  const std::string address = server->addresses().at(0);
  const Connection connection(server->in_process_channel());
  const absl::Time begin = absl::Now();
  const absl::Time end = begin + time;
  absl::Mutex lull;
  std::vector<std::unique_ptr<Traffic>> traffic;
  std::vector<std::thread> threads;
  for (uint32_t seed = 1; seed <= 3; ++seed) {
    traffic.push_back(std::make_unique<Traffic>(address, seed, lull, leaks));
    threads.emplace_back([one = traffic.back().get(), end] { one->run_until(end); });
  }
  Soak soaked;
  while (absl::Now() < end) {
    absl::SleepFor(time / 120);
    absl::MutexLock nobody(&lull);
    EXPECT_TRUE(wait_until_idle(connection));
    soaked.readings.push_back(read_now(begin, connection));
  }
  for (std::thread& thread : threads) thread.join();
  for (const auto& one : traffic) {
    soaked.served += one->served();
    soaked.cut_short += one->cut_short();
  }
  EXPECT_TRUE(wait_until_idle(connection));
  const size_t quarter = soaked.readings.size() / 4;
  soaked.readings.erase(soaked.readings.begin(),
                        soaked.readings.begin() + static_cast<std::ptrdiff_t>(quarter));
  return soaked;
}

// The quantities that grew during a soak of that length: "memory", "descriptors", "threads".
std::vector<std::string> grown(const std::vector<Reading>& readings, absl::Duration time) {
  const auto [slope, error] = memory_slope(readings);
  const Reading& first = readings.front();
  const Reading& last = readings.back();
  std::cout << "after the first quarter " << first.memory_mib << " -> " << last.memory_mib << " MiB, slope "
            << slope << " +- " << error << " MiB an hour, pool " << first.pool_mib << " -> " << last.pool_mib
            << " MiB, " << first.descriptors << " -> " << last.descriptors << " descriptors, "
            << first.threads << " -> " << last.threads << " threads\n";
  std::vector<std::string> what;
  // In a short run, caches still fill: 32 MiB in all, and a sanitizer's own memory grows by more. Leaked
  // frames of hundreds of clients would be more again.
  const bool is_long = time >= absl::Minutes(20);
  const double allowed = is_long ? 1.0 : 32.0 * kSlower / absl::ToDoubleHours(time);
  if (!(slope - 3 * error < allowed)) what.push_back("memory");
  if (is_long && !(error <= kMostError)) what.push_back("memory, perhaps: the readings vary too much");
  const auto highest = [&](size_t from, size_t to, auto of) {
    size_t value = 0;
    for (size_t i = from; i < to; ++i) value = std::max(value, readings[i].*of);
    return value;
  };
  const size_t half = readings.size() / 2;
  // The count varies because clients come and go. A leak would add one each time.
  const auto grows = [&](auto of) { return highest(half, readings.size(), of) > highest(0, half, of) + 16; };
  if (grows(&Reading::descriptors)) what.push_back("descriptors");
  if (grows(&Reading::threads)) what.push_back("threads");
  return what;
}

TEST(Soak, NothingGrowsAndWhoBehavesIsServed) {
  const Soak soaked = soak(soak_time(), /*leaks=*/false);
  std::cout << soaked.served << " served, " << soaked.cut_short << " cut short\n";
  EXPECT_GT(soaked.served, 0u);
  EXPECT_GT(soaked.cut_short, 0u);
  EXPECT_EQ(grown(soaked.readings, soak_time()), std::vector<std::string>());
  if (soak_time() >= absl::Minutes(20)) {
    record_figure("soak", soaked.readings.back().memory_mib, "MiB", soaked.readings.front().memory_mib);
  }
}

// Readings of 20 minutes that vary by so much.
std::vector<Reading> long_run(double mib_an_hour, double vary_by_mib) {
  std::mt19937 random(1);
  std::vector<Reading> readings;
  for (double t = 300; t < 1200; t += 10) {
    const double noise = std::normal_distribution<double>(0, vary_by_mib)(random);
    readings.push_back({t, 130 + mib_an_hour * t / 3600 + noise, 0, 14, 30});
  }
  return readings;
}

TEST(Soak, ASlowLeakIsSeenInALongRun) {
  const auto grown_in = [](const std::vector<Reading>& readings) {
    return grown(readings, absl::Minutes(20));
  };
  EXPECT_EQ(grown_in(long_run(0, 2)), std::vector<std::string>());
  EXPECT_EQ(grown_in(long_run(46, 2)), std::vector<std::string>{"memory"});
  EXPECT_EQ(grown_in(long_run(46, 20)).size(), 1u);  // it cannot tell, and says so
}

// The control of the soak: what it looks for is seen.
TEST(Soak, ALeakOfEachClientIsSeen) {
  constexpr absl::Duration kTime = absl::Seconds(20 * kSlower);
  const Soak soaked = soak(kTime, /*leaks=*/true);
  EXPECT_EQ(grown(soaked.readings, kTime), (std::vector<std::string>{"memory", "descriptors", "threads"}));
}

}  // namespace
}  // namespace candela::testing
