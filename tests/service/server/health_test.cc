// The health service's answers over a server's life.
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/byte_buffer.h>
#include <sys/resource.h>

#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "client/call/raw_call.h"
#include "tests/service/service_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

// grpc.health.v1's HealthCheckRequest { service = 1 } and HealthCheckResponse { status = 1 }; status 1 is
// SERVING.
bool serving(const std::shared_ptr<grpc::Channel>& channel, const std::string& service) {
  RawCall call(channel, "/grpc.health.v1.Health/Check", absl::Now() + absl::Seconds(20));
  const grpc::Slice request("\x0a" + std::string(1, static_cast<char>(service.size())) + service);
  grpc::ByteBuffer answer;
  EXPECT_TRUE(call.write(grpc::ByteBuffer(&request, 1)) && call.half_close() && call.read(answer));
  EXPECT_OK(call.finish());
  std::vector<grpc::Slice> slices;
  EXPECT_OK(answer.Dump(&slices));
  std::string bytes;
  for (const grpc::Slice& slice : slices) bytes.append(slice.begin(), slice.end());
  return bytes == "\x08\x01";
}

// A draining server is still alive. Whoever killed it because it is not ready would break its last frames.
TEST(Health, ADrainingServerIsAliveAndNotReady) {
  Config config = test_config();
  config.pre_drain = absl::Seconds(3);
  const std::unique_ptr<Server> server = start_server(config);
  const auto channel = grpc::CreateChannel(server->addresses().at(0), grpc::InsecureChannelCredentials());
  for (const char* service : {"", "candela.v1.RenderService", "readiness", "liveness"}) {
    EXPECT_TRUE(serving(channel, service)) << service;
  }
  std::thread drain([&server] { server->drain_and_stop(); });
  while (serving(channel, "readiness")) absl::SleepFor(absl::Milliseconds(5));
  EXPECT_TRUE(serving(channel, "liveness"));
  EXPECT_FALSE(serving(channel, ""));
  EXPECT_FALSE(serving(channel, "candela.v1.RenderService"));
  drain.join();
}

#ifndef CANDELA_SANITIZED  // a sanitizer needs descriptors, too
// Without a descriptor nobody can connect. The server says so, and only while that lasts.
TEST(Health, AServerThatCannotAcceptIsNotServingWhileThatLasts) {
  Config config = test_config();
  config.heartbeat_interval = absl::Milliseconds(100);
  config.heartbeat_limit = absl::Seconds(1);
  const std::unique_ptr<Server> server = start_server(config);
  const auto channel = server->in_process_channel();
  ASSERT_TRUE(serving(channel, "readiness"));
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  rlimit none = before;
  none.rlim_cur = 3;
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  const absl::Time limit = absl::Now() + absl::Seconds(20);
  while (serving(channel, "liveness") && absl::Now() < limit) absl::SleepFor(absl::Milliseconds(20));
  EXPECT_FALSE(serving(channel, "readiness"));
  EXPECT_FALSE(server->alive());
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
  while (!serving(channel, "readiness") && absl::Now() < limit) absl::SleepFor(absl::Milliseconds(20));
  EXPECT_TRUE(serving(channel, "readiness"));
  EXPECT_TRUE(server->alive());
}
#endif

TEST(Health, AnIdleServerStaysReadyByItsHeartbeat) {
  Config config = test_config();
  config.heartbeat_interval = absl::Milliseconds(100);
  config.heartbeat_limit = absl::Milliseconds(1500);
  const std::unique_ptr<Server> server = start_server(config);
  const Connection connection(server->in_process_channel());
  const auto textures_taken = [&] {
    const v1::PoolInfo pool = connection.server_info()->pool();
    return pool.hits() + pool.misses();
  };
  const uint64_t before = textures_taken();
  const auto rendered = [&] { return textures_taken() > before; };
  const absl::Time begin = absl::Now();
  while (absl::Now() < begin + absl::Seconds(3) || (!rendered() && absl::Now() < begin + absl::Seconds(30))) {
    EXPECT_OK(connection.health());
    absl::SleepFor(absl::Milliseconds(50));
  }
  EXPECT_TRUE(rendered()) << "no frame was rendered meanwhile";
  EXPECT_TRUE(wait_until_idle(connection));
}

}  // namespace
}  // namespace candela::testing
