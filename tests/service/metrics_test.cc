#include <fcntl.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <unistd.h>

#include <atomic>
#include <functional>
#include <map>
#include <thread>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/status.h"

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
  ASSERT_OK(connection.render({}, view(frame)));
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
  EXPECT_EQ(after.at("candela_memory_bytes{pool=\"frames\"}"), 0);
  EXPECT_GT(after.at("candela_memory_bytes{pool=\"textures_idle\"}"), 0);
  EXPECT_EQ(after.at("candela_memory_budget_bytes"), with_metrics().memory_budget_bytes);
  EXPECT_EQ(after.at("candela_queue_frames"), 0);

  const auto refuse = [&server](uint32_t width) {
    OpenCall call(server->in_process_channel());
    v1::RenderRequest start = start_of(natural(1, 1));
    start.mutable_start()->mutable_frame()->set_width(width);
    start.mutable_start()->mutable_frame()->set_height(v1::kMaxDimension);
    call.write(start);
    EXPECT_FALSE(call.finish().ok());
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
  OpenCall call(channel);
  call.write(start_of(frame));
  call.write(band_of(frame, 0, 10));
  call.stream->WritesDone();  // too few rows
  EXPECT_EQ(call.finish().error_code(), grpc::INVALID_ARGUMENT);
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

// The names and units are those of Prometheus's client libraries.
TEST(MetricsPort, HasTheUsualMetricsOfAProcess) {
  const std::unique_ptr<Server> server = start_server(with_metrics());
  const std::map<std::string, double> before = scrape(*server);
  EXPECT_GT(before.at("process_resident_memory_bytes"), 10e6);
  EXPECT_GT(before.at("process_virtual_memory_bytes"), before.at("process_resident_memory_bytes"));
  EXPECT_TRUE(before.contains("process_virtual_memory_max_bytes"));
  EXPECT_GE(before.at("process_threads"), 3);
  EXPECT_GT(before.at("process_open_fds"), 5);
  EXPECT_LT(before.at("process_open_fds"), before.at("process_max_fds"));
  EXPECT_LT(before.at("process_start_time_seconds"), absl::ToDoubleSeconds(absl::Now() - absl::UnixEpoch()));
  EXPECT_GT(before.at("process_start_time_seconds"),
            absl::ToDoubleSeconds(absl::Now() - absl::UnixEpoch()) - 3600);
  EXPECT_FALSE(before.contains("candela_certificate_expiry_timestamp_seconds"));

  const double cpu = before.at("process_cpu_seconds_total");
  EXPECT_GT(cpu, 0);
  const std::vector<std::byte> large(64 << 20, std::byte{1});
  const int null = open("/dev/null", O_RDONLY | O_CLOEXEC);
  std::map<std::string, double> after = scrape(*server);
  while (after.at("process_cpu_seconds_total") < cpu + 0.05) after = scrape(*server);
  EXPECT_LT(after.at("process_cpu_seconds_total"), cpu + 600);
  EXPECT_GT(after.at("process_resident_memory_bytes"),
            before.at("process_resident_memory_bytes") + (32 << 20));
  EXPECT_GT(after.at("process_open_fds"), before.at("process_open_fds"));
  EXPECT_EQ(after.at("process_start_time_seconds"), before.at("process_start_time_seconds"));
  EXPECT_EQ(large.back(), std::byte{1});
  close(null);
}

// How refusals and ends of frames change the counters of a server.
class SessionMetrics : public ::testing::Test {
 protected:
  SessionMetrics() : server_(start_server(config())), channel_(server_->in_process_channel()) {}

  static Config config() {
    Config config = with_metrics();
    config.memory_budget_bytes = 16 << 20;  // one frame of 720x720, or one that measures the tiers
    return config;
  }

  // The refusals and the ended frames while `act` runs, such as "ok 1, token 2".
  std::string counted(const std::function<void()>& act) {
    const std::map<std::string, double> before = scrape(*server_);
    act();
    EXPECT_TRUE(wait_until_idle(Connection(channel_)));
    std::vector<std::string> counts;
    for (const auto& [series, value] : scrape(*server_)) {
      if (!absl::StartsWith(series, "candela_rejections_") && !absl::StartsWith(series, "candela_frames_"))
        continue;
      const auto first = before.find(series);
      const int more = static_cast<int>(value - (first == before.end() ? 0 : first->second));
      const size_t quote = series.find('"');
      if (more != 0)
        counts.push_back(absl::StrCat(series.substr(quote + 1, series.rfind('"') - quote - 1), " ", more));
    }
    return absl::StrJoin(counts, ", ");
  }

  // The same for one session.
  std::string session(grpc::StatusCode end, const std::function<void(StreamClient&)>& act) {
    return counted([&] {
      StreamClient client(channel_);
      act(client);
      const grpc::Status status = client.finish();
      EXPECT_EQ(status.error_code(), end) << status.error_message();
    });
  }

  const WireFrame frame_ = natural(64, 36);
  const std::unique_ptr<Server> server_;
  const std::shared_ptr<grpc::Channel> channel_;
};

TEST_F(SessionMetrics, ARefusalAtTheOpenMessageIsCountedByItsReason) {
  v1::Settings wrong;
  wrong.set_prescale(-1);
  EXPECT_EQ("request 1", session(grpc::INVALID_ARGUMENT, [&](StreamClient& c) { c.open("a", wrong); }));
  EXPECT_EQ("token 1", session(grpc::FAILED_PRECONDITION,
                               [](StreamClient& c) { c.open("a", {}, std::string(50, 'x')); }));
  std::string token;
  EXPECT_EQ("ok 1", session(grpc::OK, [&](StreamClient& c) {
              c.open("first");
              c.send(frame_, 0, 0);
              StreamResult result;
              ASSERT_TRUE(c.read(result));
              token = result.token();
              c.half_close();
            }));
  EXPECT_EQ("token 1",
            session(grpc::FAILED_PRECONDITION, [&](StreamClient& c) { c.open("another", {}, token); }));
  EXPECT_EQ(
      "request 1", counted([&] {
        StreamClient first(channel_);
        first.open("taken");
        ASSERT_TRUE(wait_until(Connection(channel_), [](const auto& info) { return info.sessions() == 1; }));
        StreamClient second(channel_);
        second.open("taken");
        EXPECT_EQ(second.finish().error_code(), grpc::ALREADY_EXISTS);
        first.half_close();
        EXPECT_OK(first.finish());
      }));
}

TEST_F(SessionMetrics, ARefusalAfterTheOpenMessageIsCountedByItsReason) {
  v1::Settings wrong;
  wrong.set_prescale(-1);
  const WireFrame large = natural(2000, 2000);
  EXPECT_EQ("request 1", session(grpc::INVALID_ARGUMENT, [&](StreamClient& c) {
              c.open("a");
              c.change(0, wrong);
            }));
  EXPECT_EQ("size 1", session(grpc::RESOURCE_EXHAUSTED, [&](StreamClient& c) {
              c.open("a");
              c.send_header(large, 0, 0);
            }));
}

TEST_F(SessionMetrics, ASessionThatFindsNoMemoryIsCountedByItsReason) {
  const WireFrame large = natural(720, 720);
  std::atomic<bool> done = false;
  StreamClient holder(channel_);
  holder.open("holder");
  holder.send_header(large, 0, 0);
  holder.send_rows(large, 0, 1);
  ASSERT_TRUE(wait_until_in_use(Connection(channel_)));
  std::thread slow([&] {  // keeps its memory by sending a row now and then
    for (uint32_t y = 1; !done && y < large.desc.height; ++y) {
      holder.send_rows(large, y, 1);
      absl::SleepFor(absl::Milliseconds(100));
    }
  });
  const std::map<std::string, double> before = scrape(*server_);
  // In process, a message that the client does not read is never sent, and the server hangs up.
  StreamClient late(own_channel(server_->addresses().at(0)));
  late.open("late");
  late.send_header(large, 0, 0);
  late.send_rows(large, 0, 1);
  EXPECT_EQ(late.finish().error_code(), grpc::UNAVAILABLE);
  done = true;
  slow.join();
  const char kMemory[] = "candela_rejections_total{reason=\"memory\"}";
  EXPECT_EQ(scrape(*server_).at(kMemory) - before.at(kMemory), 1);
  holder.cancel();
  EXPECT_TRUE(wait_until_idle(Connection(channel_)));
}

// Files that a client does not take count as its memory, though their images are back in the pool.
TEST(MetricsPort, FilesThatWaitCountAsFrames) {
  Config config = with_metrics();
  config.idle_timeout = absl::Minutes(1);  // the client reads nothing
  const std::unique_ptr<Server> server = start_server(config);
  const Film noise = make_film(2, 600, 400);  // noise, so that the files are large
  grpc::ChannelArguments small_window;
  small_window.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  StreamClient slow(
      grpc::CreateCustomChannel(server->addresses().at(0), grpc::InsecureChannelCredentials(), small_window),
      false);
  v1::StreamOpen open;
  open.set_session("slow");
  open.set_encoding(v1::ENCODING_PNG);
  slow.open(open);
  for (uint64_t i = 0; i < 2; ++i) slow.send(noise->at(i), i, film_time_ns(i));
  const uint64_t image = 600 * 400 * 4;
  std::map<std::string, double> seen;
  for (int i = 0; i < 1000 && seen["candela_frames_total{result=\"ok\"}"] < 2; ++i) {
    absl::SleepFor(absl::Milliseconds(10));
    seen = scrape(*server);
  }
  seen = scrape(*server);  // a scrape reads the gauges before the counters
  EXPECT_EQ(seen["candela_memory_bytes{pool=\"textures_in_use\"}"], 0);
  EXPECT_GT(seen["candela_memory_bytes{pool=\"frames\"}"], image / 10);
  EXPECT_LT(seen["candela_memory_bytes{pool=\"frames\"}"], 2 * image);
  slow.cancel();
  EXPECT_TRUE(wait_until_idle(Connection(server->in_process_channel())));
  EXPECT_EQ(scrape(*server).at("candela_memory_bytes{pool=\"frames\"}"), 0);
}

TEST_F(SessionMetrics, AFrameThatComesTooSlowlyIsCancelled) {
  EXPECT_EQ("cancelled 1", session(grpc::DEADLINE_EXCEEDED, [&](StreamClient& c) {
              c.open("a");
              c.send_header(frame_, 0, 0);
              for (uint32_t y = 0; y < frame_.desc.height && c.send_rows(frame_, y, 1); ++y)
                absl::SleepFor(config().idle_timeout / 2);
            }));
}

// A frame that got memory ends once, with the status of what ended it.
TEST_F(SessionMetrics, AFrameEndsByWhatEndedIt) {
  const auto upload = [this](StreamClient& c) {
    c.open("a");
    c.send_header(frame_, 0, 0);
    c.send_rows(frame_, 0, 4);
    ASSERT_TRUE(wait_until_in_use(Connection(channel_)));
  };
  // A client that goes silent within a frame.
  EXPECT_EQ("cancelled 1", session(grpc::UNAVAILABLE, upload));
  EXPECT_EQ("cancelled 1", session(grpc::CANCELLED, [&](StreamClient& c) {
              upload(c);
              c.cancel();
            }));
  EXPECT_EQ("invalid_argument 1", session(grpc::INVALID_ARGUMENT, [&](StreamClient& c) {
              upload(c);
              c.send_rows(frame_, 30, 1);
            }));
  EXPECT_EQ("unavailable 1", session(grpc::UNAVAILABLE, [&](StreamClient& c) {
              upload(c);
              server_->lose_device();
              c.send_rows(frame_, 4, 32);
            }));
  EXPECT_EQ("ok 1", session(grpc::OK, [&](StreamClient& c) {
              v1::StreamOpen open = open_of("png");
              open.set_encoding(v1::ENCODING_PNG);
              c.open(open);
              c.send(frame_, 0, 0);
              c.half_close();
            }));
}

TEST_F(SessionMetrics, AFrameWhoseSessionMovesToAnotherCallIsAborted) {
  EXPECT_EQ("aborted 1, ok 1", counted([&] {
              StreamClient first(channel_);
              first.open("moves");
              first.send(frame_, 0, 0);
              StreamResult result;
              ASSERT_TRUE(first.read(result));
              EXPECT_TRUE(wait_until(Connection(channel_), [](const v1::GetServerInfoResponse& info) {
                return info.pool().bytes_in_use() == 0;
              }));
              first.send_header(frame_, 1, film_time_ns(1));
              first.send_rows(frame_, 0, 4);
              EXPECT_TRUE(wait_until_in_use(Connection(channel_)));
              StreamClient second(channel_);
              second.open("moves", {}, result.token());
              EXPECT_EQ(first.finish().error_code(), grpc::ABORTED);
              second.half_close();
              EXPECT_OK(second.finish());
            }));
}

TEST(MetricsPort, ServesNothingElseAndEndsWithTheServer) {
  std::unique_ptr<Server> server = start_server(with_metrics());
  const std::string address = server->metrics_address();
  EXPECT_TRUE(absl::StartsWith(get(address, "/"), "HTTP/1.1 404")) << get(address, "/");
  EXPECT_TRUE(absl::StartsWith(get(address, "/CMakeCache.txt"), "HTTP/1.1 404"));
  EXPECT_TRUE(says(get(address, "/metrics"), "candela_build_info{"));
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
  const absl::Status status = Server::start(config, real_clock(), alarm_timers()).status();
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
