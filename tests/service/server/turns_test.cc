// Long work takes turns: a neighbour of the client that asked for it waits no longer than beside a fair one.
#include <algorithm>
#include <atomic>
#include <functional>
#include <iostream>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/stream_client.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr absl::Duration kMeasured = absl::Seconds(8);
constexpr absl::Duration kBetweenFrames = absl::Milliseconds(100);
// For a machine that other work disturbs.
constexpr double kSlackMs = 40;

Config turns_config() {
  Config config = test_config();
  config.memory_budget_bytes = uint64_t{2} << 30;
  config.max_frame_bytes = uint64_t{128} << 20;
  config.max_calls = 80;
  config.idle_timeout = absl::Seconds(60);
  config.heartbeat_interval = absl::Milliseconds(250);
  config.heartbeat_limit = absl::Seconds(3);
  return config;
}

// Repeats a call on a thread of its own while it lives.
class Neighbour {
 public:
  explicit Neighbour(std::function<void()> call)
      : call_(std::move(call)), thread_([this] {
          while (!stop_) call_();
        }) {}
  ~Neighbour() {
    stop_ = true;
    thread_.join();
  }

 private:
  const std::function<void()> call_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;  // last: it uses the rest
};

// A client that sends a small frame ten times a second.
struct Bystander {
  std::vector<double> latencies_ms;  // ascending
  int unready = 0;                   // times that health was not SERVING
  bool alive = true;

  double p99_ms() const {
    return latencies_ms.at(static_cast<size_t>(0.99 * static_cast<double>(latencies_ms.size() - 1)));
  }
};

Bystander watch(const Server& server) {
  const Connection connection(own_channel(server.addresses().at(0)));
  const WireFrame frame = natural(160, 90);
  Bystander result;
  // The first frames prepare connection and pipelines, and let the neighbour begin.
  for (const absl::Time end = absl::Now() + absl::Seconds(2); absl::Now() < end;) {
    EXPECT_TRUE(connection.render({}, view(frame)).ok());
  }
  for (const absl::Time end = absl::Now() + kMeasured; absl::Now() < end; absl::SleepFor(kBetweenFrames)) {
    const absl::Time begin = absl::Now();
    const absl::Status status = connection.render({}, view(frame)).status();
    EXPECT_TRUE(status.ok()) << status;
    result.latencies_ms.push_back(absl::ToDoubleMilliseconds(absl::Now() - begin));
    if (!connection.health().ok()) ++result.unready;
    result.alive &= server.alive();
  }
  std::sort(result.latencies_ms.begin(), result.latencies_ms.end());
  return result;
}

void print(const char* beside, const Bystander& bystander) {
  std::cout << "160x90 beside " << beside << ": p99 " << bystander.p99_ms() << " ms, median "
            << bystander.latencies_ms[bystander.latencies_ms.size() / 2] << " ms, not ready "
            << bystander.unready << " times\n";
}

// Beside a client that streams 1280x720 as fast as it can.
Bystander beside_a_fair_neighbour(const Server& server) {
  StreamClient client(own_channel(server.addresses().at(0)));
  EXPECT_TRUE(client.open("fair"));
  const WireFrame frame = natural(1280, 720);
  constexpr uint64_t kAhead = 2;
  uint64_t sent = 0;
  const Neighbour fair([&] {
    StreamResult result;
    if (!client.send(frame, sent, static_cast<int64_t>(sent))) return;
    if (++sent > kAhead) client.read(result);
  });
  return watch(server);
}

// Renders a frame of 4 megapixels again and again.
std::function<void()> long_frames(const Server& server, const char* tier, bool verify) {
  return [connection = Connection(own_channel(server.addresses().at(0))), frame = natural(2560, 1600),
          tier = std::string(tier), verify] {
    v1::Settings settings;
    settings.set_tier(tier);
    FrameView sent = view(frame);
    sent.verify = verify;
    const absl::Status status = connection.render(settings, sent).status();
    EXPECT_TRUE(status.ok()) << status;
  };
}

// Puts another panorama of 2048x1024 each time, and bakes all its levels.
std::function<void()> bakes(const Server& server) {
  const auto texels = std::make_shared<std::vector<uint32_t>>(2048 * 1024, 0x7bffffffu);  // of RGB9E5
  auto first = std::make_shared<uint32_t>(0);
  return [connection = Connection(own_channel(server.addresses().at(0))), texels, first] {
    texels->front() = ++*first;
    Panorama panorama;
    panorama.start.set_width(2048);
    panorama.start.set_height(1024);
    panorama.start.set_format(v1::PIXEL_FORMAT_RGB9E5);
    panorama.pixels = std::as_bytes(std::span(*texels));
    ASSERT_OK_AND_ASSIGN(const v1::Environment put, connection.put_environment(panorama));
    v1::BakeEnvironmentRequest request;
    request.set_id(put.id());
    request.set_format(v1::PIXEL_FORMAT_RGBA16F);
    const absl::Status status = connection.bake_environment(request).status();
    EXPECT_TRUE(status.ok()) << status;
  };
}

// Views of 4 megapixels with so many spheres and rays that each takes seconds.
std::function<void()> heavy_views(const Server& server) {
  static const std::vector<uint32_t> texels(64 * 32, 0x7bffffffu);  // of RGB9E5
  const Connection connection(own_channel(server.addresses().at(0)));
  Panorama panorama;
  panorama.start.set_width(64);
  panorama.start.set_height(32);
  panorama.start.set_format(v1::PIXEL_FORMAT_RGB9E5);
  panorama.pixels = std::as_bytes(std::span(texels));
  const absl::StatusOr<v1::Environment> put = connection.put_environment(panorama);
  EXPECT_TRUE(put.ok()) << put.status();
  FrameView frame{.width = 2560, .height = 1600};
  frame.view.emplace().set_environment(put.ok() ? put->id() : "");
  frame.view->set_samples(16);
  for (int i = 0; i < 64; ++i) {
    v1::Sphere& sphere = *frame.view->add_objects();
    sphere.mutable_centre()->set_x(0.001 * i);
    sphere.mutable_centre()->set_z(-40 - 0.001 * i);
    sphere.set_radius(38);
    sphere.mutable_base_color()->set_x(0.5);
  }
  return [connection = Connection(own_channel(server.addresses().at(0))), frame] {
    const absl::Status status = connection.render({}, frame).status();
    EXPECT_TRUE(status.ok()) << status;
  };
}

void expect_as_beside_a_fair_one(const Bystander& bystander, const Bystander& fair) {
  EXPECT_LE(bystander.p99_ms(), 2 * fair.p99_ms() + kSlackMs);
  EXPECT_EQ(bystander.unready, 0);
  EXPECT_TRUE(bystander.alive);
}

TEST(Turns, VerifiedFramesOfOneClientDelayNobodyMoreThanAFairNeighbour) {
  const std::unique_ptr<Server> server = start_server(turns_config());
  const Bystander fair = beside_a_fair_neighbour(*server);
  print("a stream of 1280x720", fair);
  const Neighbour verifies(long_frames(*server, "standard", true));
  const Bystander bystander = watch(*server);
  print("4 MP frames that are verified", bystander);
  expect_as_beside_a_fair_one(bystander, fair);
}

TEST(Turns, ReferenceFramesOfOneClientDelayNobodyMoreThanAFairNeighbour) {
  const std::unique_ptr<Server> server = start_server(turns_config());
  const Bystander fair = beside_a_fair_neighbour(*server);
  print("a stream of 1280x720", fair);
  const Neighbour renders(long_frames(*server, "reference", false));
  const Bystander bystander = watch(*server);
  print("4 MP frames by the reference", bystander);
  expect_as_beside_a_fair_one(bystander, fair);
}

TEST(Turns, BakesOfOneClientDelayNobodyMoreThanAFairNeighbour) {
  const std::unique_ptr<Server> server = start_server(turns_config());
  const Bystander fair = beside_a_fair_neighbour(*server);
  print("a stream of 1280x720", fair);
  const Neighbour renders(bakes(*server));
  const Bystander bystander = watch(*server);
  print("panoramas of 2048x1024 that are put and baked", bystander);
  expect_as_beside_a_fair_one(bystander, fair);
}

TEST(Turns, HeavyViewsOfOneClientDelayNobodyMoreThanAFairNeighbour) {
  for (const ExecutorKind passes : {ExecutorKind::kAuto, ExecutorKind::kDevice}) {
    Config config = turns_config();
    config.passes = passes;
    const std::unique_ptr<Server> server = start_server(config);
    const Bystander fair = beside_a_fair_neighbour(*server);
    print("a stream of 1280x720", fair);
    const Neighbour views(heavy_views(*server));
    const Bystander bystander = watch(*server);
    print("views of 64 spheres with 16 rays a pixel", bystander);
    expect_as_beside_a_fair_one(bystander, fair);
  }
}

// The control of the tests above: without slices they fail.
TEST(Turns, WithoutSlicesABystanderWaitsForWholeFrames) {
  Config config = turns_config();
  config.slice = absl::InfiniteDuration();
  const std::unique_ptr<Server> server = start_server(config);
  const Bystander fair = beside_a_fair_neighbour(*server);
  const Neighbour verifies(long_frames(*server, "standard", true));
  const Bystander bystander = watch(*server);
  print("4 MP frames that are verified at one go", bystander);
  // It gets only a few frames through, so the longest counts.
  EXPECT_GT(bystander.latencies_ms.back(), 2 * fair.p99_ms() + kSlackMs);
}

}  // namespace
}  // namespace candela::testing
