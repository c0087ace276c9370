// Long work takes turns: a neighbour of the client that asked for it waits no longer than beside a fair one.
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/device_fixture.h"
#include "tests/support/figures.h"
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

// What a client saw that sends a small frame ten times a second.
struct Watched {
  std::vector<double> latencies_ms;
  int unready = 0;  // times that health was not SERVING
  bool alive = true;

  double p99_ms() const { return quantile(latencies_ms, 0.99); }
};

Watched watch(const Server& server, const char* beside) {
  const Connection connection(own_channel(server.addresses().at(0)));
  const WireFrame frame = natural(160, 90);
  Watched result;
  // The first frames prepare connection and pipelines, and let the neighbour begin.
  for (const absl::Time end = absl::Now() + absl::Seconds(2); absl::Now() < end;) {
    EXPECT_OK(connection.render({}, view(frame)));
  }
  for (const absl::Time end = absl::Now() + kMeasured; absl::Now() < end; absl::SleepFor(kBetweenFrames)) {
    const absl::Time begin = absl::Now();
    EXPECT_OK(connection.render({}, view(frame)));
    result.latencies_ms.push_back(absl::ToDoubleMilliseconds(absl::Now() - begin));
    if (!connection.health().ok()) ++result.unready;
    result.alive &= server.alive();
  }
  std::cout << "160x90 beside " << beside << ": p99 " << result.p99_ms() << " ms, median "
            << quantile(result.latencies_ms, 0.5) << " ms, not ready " << result.unready << " times\n";
  return result;
}

Watched beside_a_fair_neighbour(const Server& server) {
  const Load fair(server.addresses().at(0), "fair", natural(1280, 720));
  return watch(server, "a stream of 1280x720");
}

// Renders a frame of 4 megapixels again and again.
std::function<void()> long_frames(const Server& server, const char* tier, bool verify) {
  return [connection = Connection(own_channel(server.addresses().at(0))), frame = natural(2560, 1600),
          tier = std::string(tier), verify] {
    v1::Settings settings;
    settings.set_tier(tier);
    FrameView sent = view(frame);
    sent.verify = verify;
    EXPECT_OK(connection.render(settings, sent));
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
    EXPECT_OK(connection.bake_environment(request));
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
  EXPECT_OK(put);
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
    EXPECT_OK(connection.render({}, frame));
  };
}

struct LongWork {
  const char* name;
  const char* is;
  std::function<void()> (*of)(const Server&);
  ExecutorKind executor = executor_of_environment();
};

class Turns : public ::testing::TestWithParam<LongWork> {};

TEST_P(Turns, DelayNobodyMoreThanAFairNeighbour) {
  Config config = turns_config();
  config.executor = GetParam().executor;
  const std::unique_ptr<Server> server = start_server(config);
  const Watched fair = beside_a_fair_neighbour(*server);
  const Repeated works(GetParam().of(*server));
  const Watched bystander = watch(*server, GetParam().is);
  EXPECT_LE(bystander.p99_ms(), 2 * fair.p99_ms() + kSlackMs);
  EXPECT_EQ(bystander.unready, 0);
  EXPECT_TRUE(bystander.alive);
  record_figure(absl::StrCat("turns/", GetParam().name), bystander.p99_ms(), "ms", fair.p99_ms());
}

INSTANTIATE_TEST_SUITE_P(
    OfOneClient, Turns,
    ::testing::Values(
        LongWork{"VerifiedFrames", "4 MP frames that are verified",
                 [](const Server& server) { return long_frames(server, "standard", true); }},
        LongWork{"ReferenceFrames", "4 MP frames by the reference",
                 [](const Server& server) { return long_frames(server, "reference", false); }},
        LongWork{"Bakes", "panoramas of 2048x1024 that are put and baked", bakes},
        LongWork{"HeavyViews", "views of 64 spheres with 16 rays a pixel", heavy_views, ExecutorKind::kAuto},
        LongWork{"HeavyViewsOnTheDevice", "the same on the device", heavy_views, ExecutorKind::kDevice}),
    [](const auto& work) { return std::string(work.param.name); });

// The control of the test above: without slices it fails.
TEST_F(Turns, WithoutSlicesABystanderWaitsForWholeFrames) {
  Config config = turns_config();
  config.slice = absl::InfiniteDuration();
  const std::unique_ptr<Server> server = start_server(config);
  const Watched fair = beside_a_fair_neighbour(*server);
  const Repeated verifies(long_frames(*server, "standard", true));
  const Watched bystander = watch(*server, "4 MP frames that are verified at one go");
  // It gets only a few frames through, so the longest counts.
  const double longest_ms = quantile(bystander.latencies_ms, 1);
  EXPECT_GT(longest_ms, 2 * fair.p99_ms() + kSlackMs);
  record_figure("turns/without_slices", longest_ms, "ms", fair.p99_ms());
}

}  // namespace
}  // namespace candela::testing
