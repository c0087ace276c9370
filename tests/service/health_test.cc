// A server's health, and what it tells of itself.
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/byte_buffer.h>
#include <sys/resource.h>

#include <set>
#include <string>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "client/call/raw_call.h"
#include "proto/candela/v1/settings.h"
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

// Server information and reflection.

class Discovery : public ServiceTest {
 protected:
  // Calls a method with one request and returns its answer, both as bytes.
  static absl::StatusOr<std::string> ask(const std::string& method, const std::string& request) {
    RawCall call(channel(), method, absl::Now() + absl::Seconds(20));
    const grpc::Slice slice(request);
    grpc::ByteBuffer answer;
    const bool answered = call.write(grpc::ByteBuffer(&slice, 1)) && call.half_close() && call.read(answer);
    const grpc::Status status = call.finish();
    if (!status.ok())
      return absl::Status(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
    std::string bytes;
    std::vector<grpc::Slice> slices;
    if (answered && answer.Dump(&slices).ok()) {
      for (const grpc::Slice& part : slices) bytes.append(part.begin(), part.end());
    }
    return bytes;
  }
};
INSTANTIATE_TEST_SUITE_P(Transport, Discovery, ::testing::Bool(), transport_name);

TEST_P(Discovery, HealthAnswersForTheServerAndForTheService) {
  EXPECT_OK(connection().health());
  const std::string serving("\x08\x01", 2);
  EXPECT_EQ(ask("/grpc.health.v1.Health/Check", "").value(), serving);
  for (const std::string service : {v1::RenderService::service_full_name(), "liveness", "readiness"}) {
    EXPECT_EQ(ask("/grpc.health.v1.Health/Check",
                  "\x0a" + std::string(1, static_cast<char>(service.size())) + service)
                  .value(),
              serving)
        << service;
  }
  EXPECT_TRUE(absl::IsNotFound(ask("/grpc.health.v1.Health/Check", "\x0a\x04nope").status()));
}

TEST_P(Discovery, ReflectionListsTheService) {
  // ServerReflectionRequest { list_services: "" }
  ASSERT_OK_AND_ASSIGN(
      const std::string answer,
      ask("/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", std::string("\x3a\x00", 2)));
  EXPECT_TRUE(says(answer, "candela.v1.RenderService"));
}

TEST_P(Discovery, ServerInfoTellsLimitsFormatsAndTheDevice) {
  ASSERT_OK_AND_ASSIGN(const v1::GetServerInfoResponse info, connection().server_info());
  EXPECT_FALSE(info.version().empty());
  EXPECT_EQ(info.device().name(), server().device_name());
  EXPECT_FALSE(info.device().type().empty());
  EXPECT_EQ(info.formats_size(), 5);
  EXPECT_EQ(info.output_formats_size(), 3);
  EXPECT_EQ(info.curves_size(), v1::ToneCurve_ARRAYSIZE - 1);
  EXPECT_EQ(info.transfers_size(), v1::Transfer_ARRAYSIZE - 1);
  EXPECT_EQ(info.limits().max_frame_bytes(), uint64_t{64} << 20);
  EXPECT_EQ(info.limits().max_dimension(), v1::kMaxDimension);
  EXPECT_EQ(info.limits().max_band_bytes(), v1::kMaxBandBytes);
  EXPECT_EQ(info.limits().memory_budget_bytes(), uint64_t{256} << 20);
  EXPECT_EQ(info.limits().max_sessions(), 5u);
  EXPECT_EQ(info.limits().max_frames_in_flight(), 3u);
  ASSERT_GT(info.tiers_size(), 0);
  std::set<std::string> tiers;
  for (const v1::Tier& tier : info.tiers()) tiers.insert(tier.name());
  EXPECT_TRUE(tiers.count("standard"));
}

TEST_P(Discovery, ServerInfoTellsTheBoundsOfEveryTier) {
  ASSERT_OK_AND_ASSIGN(const v1::GetServerInfoResponse info, connection().server_info());
  ASSERT_EQ(info.tiers_size(), 3);  // draft, standard, reference
  double bound = 255;
  for (const v1::Tier& tier : info.tiers()) {
    EXPECT_LT(tier.max_error_codes(), bound) << tier.name();
    EXPECT_GE(tier.max_error_codes_with_bloom(), tier.max_error_codes()) << tier.name();
    EXPECT_EQ(tier.max_error_codes() > 0, tier.name() != "reference") << tier.name();
    bound = tier.max_error_codes();
  }
}

TEST_P(Discovery, ServerInfoListsEverySetting) {
  ASSERT_OK_AND_ASSIGN(const v1::GetServerInfoResponse info, connection().server_info());
  const std::vector<v1::SettingField>& fields = v1::setting_fields();
  ASSERT_EQ(static_cast<size_t>(info.settings_size()), fields.size());
  for (size_t i = 0; i < fields.size(); ++i) {
    const v1::SettingInfo& setting = info.settings(static_cast<int>(i));
    EXPECT_EQ(setting.path(), fields[i].path);
    EXPECT_EQ(v1::deterministic_bytes(setting), v1::deterministic_bytes(v1::setting_info(fields[i])));
  }
}

TEST_P(Discovery, FramesRenderedAreCounted) {
  const uint64_t before = connection().server_info()->frames_rendered();
  ASSERT_OK(connection().render({}, view(natural(3, 3))));
  EXPECT_EQ(connection().server_info()->frames_rendered(), before + 1);
}

TEST_P(Discovery, AnUnknownMethodIsUnimplemented) {
  EXPECT_TRUE(absl::IsUnimplemented(ask("/candela.v1.RenderService/Nothing", "").status()));
}

TEST(UnreachableServer, TheErrorNamesTheAddressAndTheWayOut) {
  ASSERT_OK_AND_ASSIGN(const Connection connection, Connection::open("127.0.0.1:1"));
  for (const absl::Status& status : {connection.health(), connection.server_info().status(),
                                     connection.render({}, view(natural(2, 2))).status()}) {
    EXPECT_REFUSED(kUnavailable, "", status);
    const std::string message(status.message());
    EXPECT_EQ(message.rfind("cannot reach 127.0.0.1:1: ", 0), 0u) << message;
    EXPECT_TRUE(says(message, "candelad --listen 127.0.0.1:1, or name another server"));
  }
}

TEST(UnreachableServer, AnAddressOfAnotherShapeIsRefused) {
  for (const char* bad : {"", "localhost", "http://localhost:1", "localhost:0", "localhost:99999", "unix:"}) {
    EXPECT_REFUSED(kInvalidArgument, "", Connection::open(bad)) << bad;
  }
}

}  // namespace
}  // namespace candela::testing
