#include "tests/service/service_fixture.h"

#include <arpa/inet.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/channel_arguments.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <climits>
#include <sstream>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "tests/support/device_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {

std::unique_ptr<Server> ServiceTest::server_;

Config test_config() {
  Config config;
  config.executor = executor_of_environment();
  config.listen = {"127.0.0.1:0"};
  config.memory_budget_bytes = uint64_t{256} << 20;
  config.max_frame_bytes = uint64_t{64} << 20;
  config.max_calls = kMaxCalls;
  config.max_sessions = 5;
  config.max_frames_in_flight = 3;
  config.heartbeat_interval = absl::Hours(1);  // only the tests send frames
  config.heartbeat_limit = absl::Hours(2);
  // Less than the 2 s after which a slow upload loses its memory to a frame that waits.
  config.idle_timeout = absl::Milliseconds(kSlower == 1 ? 800 : 1800);
  return config;
}

std::unique_ptr<Server> start_server(const Config& config) {
  return start_server(config, real_clock(), alarm_timers());
}

std::unique_ptr<Server> start_server(const Config& config, Clock& clock, Timers& timers) {
  absl::StatusOr<std::unique_ptr<Server>> server = Server::start(config, clock, timers);
  EXPECT_TRUE(server.ok()) << server.status();
  keep_driver_loaded();
  return server.ok() ? *std::move(server) : nullptr;
}

v1::PixelFormat wire_format(v1::PixelFormat format) { return static_cast<v1::PixelFormat>(format); }

FrameView view(const WireFrame& frame, uint64_t sequence) {
  return {.width = frame.desc.width,
          .height = frame.desc.height,
          .format = wire_format(frame.desc.format),
          .pixels = frame.pixels,
          .sequence = sequence};
}

v1::RenderRequest start_of(const WireFrame& frame) {
  v1::RenderRequest request;
  v1::FrameHeader& header = *request.mutable_start()->mutable_frame();
  header.set_width(frame.desc.width);
  header.set_height(frame.desc.height);
  header.set_format(wire_format(frame.desc.format));
  return request;
}

v1::RenderRequest band_of(const WireFrame& frame, uint32_t first_row, uint32_t rows) {
  v1::RenderRequest request;
  request.mutable_band()->set_first_row(first_row);
  request.mutable_band()->set_pixels(frame.pixels.data() + first_row * frame.desc.row_bytes(),
                                     rows * frame.desc.row_bytes());
  return request;
}

OpenCall::OpenCall(const std::shared_ptr<grpc::Channel>& channel,
                   const std::function<void(grpc::ClientContext&)>& prepare)
    : stub(v1::RenderService::NewStub(channel)) {
  if (prepare) prepare(context);
  stream = stub->Render(&context);
}

grpc::Status OpenCall::finish() {
  v1::RenderResponse response;
  while (stream->Read(&response)) {
  }
  return stream->Finish();
}

std::shared_ptr<grpc::Channel> own_channel(const std::string& address) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  // gRPC may miss a reset (server/grpc_listener.cc says why). Only a write reveals it, so clients ping. They
  // need no answer, because some tests read nothing.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 5000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, INT_MAX);
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  return grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
}

bool wait_until(const Connection& connection,
                const std::function<bool(const v1::GetServerInfoResponse&)>& is_so) {
  const absl::Time limit = absl::Now() + absl::Minutes(1);
  while (absl::Now() < limit) {
    const absl::StatusOr<v1::GetServerInfoResponse> info = connection.server_info();
    if (info.ok() && is_so(*info)) return true;
    absl::SleepFor(absl::Milliseconds(2));
  }
  return false;
}

bool wait_until_idle(const Connection& connection) {
  return wait_until(connection, [](const v1::GetServerInfoResponse& info) {
    return info.pool().bytes_in_use() == 0 && info.sessions() == 0;
  });
}

bool wait_until_in_use(const Connection& connection) {
  return wait_until(connection,
                    [](const v1::GetServerInfoResponse& info) { return info.pool().bytes_in_use() > 0; });
}

void ServiceTest::SetUpTestSuite() { server_ = start_server(test_config()); }

void ServiceTest::TearDownTestSuite() { server_.reset(); }

void ServiceTest::TearDown() {
  EXPECT_TRUE(wait_until_idle(connection())) << "a frame's memory was not given back";
  EXPECT_EQ(server().validation_messages(), 0u) << "the validation layers had something to say";
}

std::shared_ptr<grpc::Channel> ServiceTest::channel() {
  if (GetParam()) return server_->in_process_channel();
  return grpc::CreateChannel(server_->addresses().at(0), grpc::InsecureChannelCredentials());
}

v1::PoolInfo ServiceTest::pool() {
  const absl::StatusOr<v1::GetServerInfoResponse> info = connection().server_info();
  EXPECT_OK(info);
  return info.ok() ? info->pool() : v1::PoolInfo();
}

std::string transport_name(const ::testing::TestParamInfo<bool>& info) {
  return info.param ? "InProcess" : "Tcp";
}

std::string get(const std::string& address, const std::string& path) {
  const int connection = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<uint16_t>(std::stoi(address.substr(address.rfind(':') + 1))));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string answer;
  if (connect(connection, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0) {
    const std::string request =
        absl::StrCat("GET ", path, " HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
    EXPECT_EQ(send(connection, request.data(), request.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(request.size()));
    char buffer[4096];
    for (ssize_t count = 0; (count = recv(connection, buffer, sizeof buffer, 0)) > 0;) {
      answer.append(buffer, static_cast<size_t>(count));
    }
  }
  close(connection);
  return answer;
}

std::map<std::string, double> scrape(const Server& server) {
  const std::string answer = get(server.metrics_address(), "/metrics");
  EXPECT_TRUE(absl::StartsWith(answer, "HTTP/1.1 200")) << answer;
  std::map<std::string, double> values;
  std::istringstream lines(answer);
  for (std::string line; std::getline(lines, line);) {
    const size_t space = line.rfind(' ');
    double value = 0;
    if ((absl::StartsWith(line, "candela_") || absl::StartsWith(line, "process_")) &&
        absl::SimpleAtod(line.substr(space + 1), &value)) {
      values[line.substr(0, space)] = value;
    }
  }
  return values;
}

}  // namespace candela::testing
