// Concurrent sessions share the device fairly, and a slow session does not disturb the others.
#include <algorithm>
#include <atomic>
#include <iostream>
#include <thread>

#include "absl/time/clock.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/figures.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

Config large_config() {
  Config config = test_config();
  config.memory_budget_bytes = uint64_t{1} << 30;
  config.max_frame_bytes = uint64_t{128} << 20;
  config.idle_timeout = absl::Seconds(60);
  return config;
}

TEST(Fairness, AHeavySessionTakesNoMoreThanItsShare) {
  const std::unique_ptr<Server> server = start_server(large_config());
  const std::string& address = server->addresses().at(0);
  std::vector<std::unique_ptr<Load>> loads;
  loads.push_back(std::make_unique<Load>(address, "heavy", natural(3840, 2160)));
  for (int i = 0; i < 3; ++i) {
    loads.push_back(std::make_unique<Load>(address, "light" + std::to_string(i), natural(1280, 720)));
  }
  const auto all_answered = [&] {
    return std::all_of(loads.begin(), loads.end(), [](const auto& load) { return load->answered() >= 2; });
  };
  const absl::Time limit = absl::Now() + absl::Minutes(2);
  while (!all_answered() && absl::Now() < limit) absl::SleepFor(absl::Milliseconds(5));
  for (const auto& load : loads) load->measure(true);
  const uint64_t before = loads[0]->answered();
  const absl::Time begin = absl::Now();
  // So many frames of the heavy session that one more or less does not matter.
  while (absl::Now() - begin < absl::Seconds(4) ||
         (loads[0]->answered() < before + 8 && absl::Now() < limit)) {
    absl::SleepFor(absl::Milliseconds(20));
  }
  for (const auto& load : loads) load->measure(false);
  for (const auto& load : loads) load->stop();
  double all = 0;
  for (const auto& load : loads) all += load->device_ns();
  for (size_t i = 0; i < loads.size(); ++i) {
    const double share = loads[i]->device_ns() / all;
    std::cout << (i == 0 ? "3840x2160" : "1280x720") << ": " << share << " of the device's time\n";
    EXPECT_TRUE(i == 0 || share >= 0.8 * 0.25);
  }
}

uint64_t frames_rendered(const Connection& connection) {
  const absl::StatusOr<v1::GetServerInfoResponse> info = connection.server_info();
  return info.ok() ? info->frames_rendered() : 0;
}

// A session that sends as many frames as the server accepts, and then reads one kilobyte of results a second.
class SlowReader {
 public:
  SlowReader(const std::string& address, const std::string& session)
      : wire_(address), client_(own_channel(wire_.address()), /*reads=*/false) {
    // A result has 16.6 MB, far more than TCP's buffers hold.
    v1::Settings settings;
    settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
    client_.open(session, settings);
    sender_ = std::thread([this] {
      const WireFrame frame = natural(1920, 1080);
      for (uint64_t i = 0; client_.send(frame, i, static_cast<int64_t>(i)); ++i) {
      }
    });
  }
  ~SlowReader() {
    wire_.cut();
    sender_.join();
    if (receiver_.joinable()) receiver_.join();
  }

  // Before that it reads nothing. Not `slow`: it reads as fast as it can.
  void begin_to_read(bool slow) {
    if (slow) wire_.slow_to_client(1024);
    receiver_ = std::thread([this] {
      StreamResult result;
      while (client_.read(result)) {
      }
    });
  }

 private:
  WireCutter wire_;
  StreamClient client_;
  std::thread sender_;
  std::thread receiver_;
};

// The bystander's frames are rendered, and none of the reader's beyond those that it may have in flight.
TEST(Fairness, ASlowReaderHoldsNoTimeOfTheDevice) {
  const Config config = large_config();
  const std::unique_ptr<Server> server = start_server(config);
  const Connection witness(server->in_process_channel());
  SlowReader reader(server->addresses().at(0), "reader");
  const uint64_t in_flight = config.max_frames_in_flight;
  ASSERT_TRUE(wait_until(witness, [&](const auto& info) { return info.frames_rendered() == in_flight; }));
  for (int i = 0; i < 30; ++i) EXPECT_OK(witness.render({}, view(natural(64, 36))));
  EXPECT_EQ(frames_rendered(witness), in_flight + 30);
}

// Rounds with and without the slow session alternate, so that other load on the machine affects both. The
// control is a session that reads fast: it takes its share of the device, and the same bound must see that.
// If the noise of the machine hides the control, the test measures again.
TEST(Fairness, ASlowReaderRaisesNobodysLatency) {
  constexpr int kRounds = 10, kFrames = 60 / kSlower, kMeasurements = 4;
  enum Reader { kNone, kSlow, kFast, kReaders };
  const Config config = large_config();
  const std::unique_ptr<Server> server = start_server(config);
  const std::string& address = server->addresses().at(0);
  const Connection witness(server->in_process_channel());
  Bystander bystander(address, natural(640, 360));
  bystander.latencies_ms(kFrames);
  // The p99 of a round, in ms.
  const auto p99_ms = [&](Reader kind, const std::string& session) {
    std::unique_ptr<SlowReader> reader;
    const uint64_t before = frames_rendered(witness);
    if (kind != kNone) {
      reader = std::make_unique<SlowReader>(address, session);
      EXPECT_TRUE(wait_until(witness, [&](const v1::GetServerInfoResponse& info) {
        return info.frames_rendered() == before + config.max_frames_in_flight;
      }));
      reader->begin_to_read(kind == kSlow);
    }
    const std::vector<double> latencies = bystander.latencies_ms(kFrames);
    // The result of a slow reader's first frame is still being sent. Until that ends, no other frame of it is
    // rendered.
    const uint64_t others = kind == kSlow ? config.max_frames_in_flight : 0;
    if (kind != kFast) {
      EXPECT_EQ(frames_rendered(witness) - before, kFrames + others);
    }
    reader.reset();
    // A frame that was being rendered for the reader ends later than its session.
    EXPECT_TRUE(wait_until(witness, [](const v1::GetServerInfoResponse& info) {
      return info.sessions() == 1 && info.pool().bytes_in_use() == 0;
    }));
    return quantile(latencies, 0.99);
  };
  bool conclusive = false;
  for (int measurement = 0; !conclusive && measurement < kMeasurements; ++measurement) {
    std::vector<double> p99[kReaders];
    for (int round = 0; round < kReaders * kRounds; ++round) {
      const auto kind = static_cast<Reader>(round % kReaders);
      p99[kind].push_back(p99_ms(kind, "reader" + std::to_string(measurement) + "-" + std::to_string(round)));
      ASSERT_FALSE(HasFailure());
    }
    const double alone = quantile(p99[kNone], 0.5);
    const double slow = quantile(p99[kSlow], 0.5);
    const double fast = quantile(p99[kFast], 0.5);
    // In addition to the 10 %, allow the variation of the rounds without another session.
    const double limit = 1.1 * alone + quantile(p99[kNone], 0.9) - quantile(p99[kNone], 0.1);
    std::cout << "p99, median of " << kRounds << " rounds: " << alone << " ms alone, " << slow
              << " ms beside a slow reader, " << fast << " ms beside a fast one; limit " << limit << " ms\n";
    conclusive = fast > limit;
    if (conclusive) {
      EXPECT_LE(slow, limit);
      record_figure("fairness/slow_reader", slow, "ms", alone);
    }
  }
  EXPECT_TRUE(conclusive) << "the bound never saw a session that takes its share";
}

}  // namespace
}  // namespace candela::testing
