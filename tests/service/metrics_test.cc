#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include <map>
#include <thread>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "tests/service/scrape.h"
#include "tests/service/service_fixture.h"

namespace candela::testing {
namespace {

Config with_metrics() {
  Config config = test_config();
  config.metrics = "127.0.0.1:0";
  return config;
}

TEST(MetricsPort, CountersMoveWithARenderAndWithARejection) {
  const std::unique_ptr<Server> server = start_server(with_metrics());
  const Connection connection(server->in_process_channel());
  std::map<std::string, double> before = scrape(*server);
  EXPECT_EQ(before.at("candela_frames_total{result=\"ok\"}"), 0);
  EXPECT_EQ(before.at("candela_frames_total{result=\"unavailable\"}"), 0);
  EXPECT_EQ(before.at("candela_rejections_total{reason=\"size\"}"), 0);
  EXPECT_EQ(before.at("candela_serving"), 1);
  EXPECT_NEAR(before.at("candela_start_time_seconds"), absl::ToDoubleSeconds(absl::Now() - absl::UnixEpoch()),
              60);
  EXPECT_EQ(before.at("candela_sessions"), 0);

  const WireFrame frame = natural(320, 240);
  ASSERT_TRUE(connection.render({}, view(frame)).ok());
  ASSERT_TRUE(wait_until_idle(connection));
  std::map<std::string, double> after = scrape(*server);
  EXPECT_EQ(after.at("candela_frames_total{result=\"ok\"}"), 1);
  EXPECT_EQ(after.at("candela_frame_stage_duration_seconds_count{stage=\"queue\"}"), 1);
  EXPECT_EQ(after.at("candela_frame_stage_duration_seconds_count{stage=\"ingest\"}"), 1);
  EXPECT_GT(after.at("candela_frame_stage_duration_seconds_sum{stage=\"resolve\"}"), 0);
  EXPECT_LT(after.at("candela_frame_stage_duration_seconds_sum{stage=\"resolve\"}"), 10);
  EXPECT_GE(after.at("candela_bytes_total{direction=\"in\"}"), frame.pixels.size());
  EXPECT_LT(after.at("candela_bytes_total{direction=\"in\"}"), frame.pixels.size() + 1000);
  EXPECT_GE(after.at("candela_bytes_total{direction=\"out\"}"), 320 * 240 * 4);
  EXPECT_LT(after.at("candela_bytes_total{direction=\"out\"}"), 320 * 240 * 4 + 10000);
  EXPECT_EQ(after.at("candela_memory_bytes{pool=\"textures_in_use\"}"), 0);
  EXPECT_GT(after.at("candela_memory_bytes{pool=\"textures_idle\"}"), 0);
  EXPECT_EQ(after.at("candela_memory_budget_bytes"), with_metrics().memory_budget_bytes);
  EXPECT_EQ(after.at("candela_queue_frames"), 0);

  const auto stub = v1::RenderService::NewStub(server->in_process_channel());
  const auto refuse = [&stub](uint32_t width) {
    grpc::ClientContext context;
    const auto stream = stub->Render(&context);
    v1::RenderRequest start = start_of(natural(1, 1));
    start.mutable_start()->mutable_frame()->set_width(width);
    start.mutable_start()->mutable_frame()->set_height(v1::kMaxDimension);
    stream->Write(start);
    v1::RenderResponse response;
    while (stream->Read(&response)) {
    }
    EXPECT_FALSE(stream->Finish().ok());
  };
  refuse(v1::kMaxDimension);
  refuse(0);
  after = scrape(*server);
  EXPECT_EQ(after.at("candela_rejections_total{reason=\"size\"}"), 1);
  EXPECT_EQ(after.at("candela_rejections_total{reason=\"request\"}"), 1);
  EXPECT_EQ(after.at("candela_frames_total{result=\"ok\"}"), 1);
}

TEST(MetricsPort, AFrameThatEndsOtherwiseIsCountedOnceByItsStatus) {
  const std::unique_ptr<Server> server = start_server(with_metrics());
  const auto channel = server->in_process_channel();
  const WireFrame frame = natural(64, 64);
  const auto stub = v1::RenderService::NewStub(channel);
  grpc::ClientContext context;
  const auto stream = stub->Render(&context);
  stream->Write(start_of(frame));
  stream->Write(band_of(frame, 0, 10));
  stream->WritesDone();  // too few rows
  v1::RenderResponse response;
  while (stream->Read(&response)) {
  }
  EXPECT_EQ(stream->Finish().error_code(), grpc::INVALID_ARGUMENT);
  v1::Settings reject;
  reject.set_bad_values(v1::BAD_VALUES_REJECT);
  WireFrame bad = flat(8, 8, {1, 1, 1, 1});
  std::fill(bad.pixels.begin(), bad.pixels.end(), std::byte{0xff});  // NaN
  EXPECT_FALSE(Connection(channel).render(reject, view(bad)).ok());
  const std::map<std::string, double> values = scrape(*server);
  EXPECT_EQ(values.at("candela_frames_total{result=\"invalid_argument\"}"), 2);
  EXPECT_EQ(values.at("candela_frames_total{result=\"ok\"}"), 0);
  EXPECT_EQ(values.at("candela_rejections_total{reason=\"request\"}"), 0);
}

TEST(MetricsPort, ServesNothingElseAndEndsWithTheServer) {
  std::unique_ptr<Server> server = start_server(with_metrics());
  const std::string address = server->metrics_address();
  EXPECT_TRUE(absl::StartsWith(get(address, "/"), "HTTP/1.1 404")) << get(address, "/");
  EXPECT_TRUE(absl::StartsWith(get(address, "/CMakeCache.txt"), "HTTP/1.1 404"));
  EXPECT_NE(get(address, "/metrics").find("candela_build_info{"), std::string::npos);
  server->drain_and_stop();
  EXPECT_EQ(get(address, "/metrics"), "");
}

TEST(MetricsPort, LivezAndReadyzSayWhatHealthSays) {
  Config config = with_metrics();
  config.pre_drain = absl::Seconds(1);
  const std::unique_ptr<Server> server = start_server(config);
  const std::string address = server->metrics_address();
  const auto says = [&address](const std::string& path) { return get(address, path).substr(9, 3); };
  EXPECT_EQ(says("/livez"), "200");
  EXPECT_EQ(says("/readyz"), "200");
  EXPECT_EQ(says("/readyz/more"), "404");
  std::thread drain([&server] { server->drain_and_stop(); });
  const absl::Time limit = absl::Now() + absl::Milliseconds(900);
  while (says("/readyz") == "200" && absl::Now() < limit) absl::SleepFor(absl::Milliseconds(5));
  EXPECT_EQ(says("/readyz"), "503");
  EXPECT_EQ(says("/livez"), "200");
  drain.join();
}

TEST(MetricsPort, AnAddressThatIsTakenFailsTheStartInOneLine) {
  const std::unique_ptr<Server> first = start_server(with_metrics());
  Config config = test_config();
  config.metrics = first->metrics_address();
  const absl::Status status = Server::start(config).status();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_NE(std::string(status.message()).find("cannot serve metrics on " + config.metrics),
            std::string::npos);
  EXPECT_EQ(std::string(status.message()).find('\n'), std::string::npos);
  EXPECT_NE(get(first->metrics_address(), "/metrics"), "");
}

TEST(MetricsPort, AServerWithoutAnAddressServesNone) {
  const std::unique_ptr<Server> server = start_server(test_config());
  EXPECT_EQ(server->metrics_address(), "");
}

}  // namespace
}  // namespace candela::testing
