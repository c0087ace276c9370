// A Vulkan device that hangs, which the tests simulate: a submission never ends.
#include <sys/stat.h>

#include <atomic>
#include <thread>

#include "absl/time/clock.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

// The limit of hanging_candelad. A slow machine must not reach it without a hang.
constexpr absl::Duration kHangLimit = absl::Seconds(15);

TEST(DeviceHang, FramesOfSingleCallsAreToldUnavailableAndTheServerStopsWithoutTheDevice) {
  std::atomic<int> gone = 0;
  Config config = test_config();
  config.executor = ExecutorKind::kDevice;  // only the device hangs
  config.hang_limit = kHangLimit;
  config.idle_timeout = absl::Minutes(1);
  ASSERT_OK_AND_ASSIGN(std::unique_ptr<Server> server,
                       Server::start(config, real_clock(), alarm_timers(), [&gone] { ++gone; }));
  const Connection connection(server->in_process_channel());
  const WireFrame frame = natural(160, 90);
  ASSERT_OK(connection.render({}, view(frame)));
  server->hang_device();
  absl::Status statuses[2];
  const absl::Time begin = absl::Now();
  {
    std::thread waits([&] { statuses[1] = connection.render({}, view(frame)).status(); });
    statuses[0] = connection.render({}, view(frame)).status();
    waits.join();
  }
  EXPECT_GE(absl::Now() - begin, kHangLimit);
  for (const absl::Status& status : statuses) EXPECT_REFUSED(kUnavailable, "hangs", status);
  // From then on nothing waits for the device.
  const absl::Time later = absl::Now();
  EXPECT_TRUE(absl::IsUnavailable(connection.render({}, view(frame)).status()));
  EXPECT_LT(absl::Now() - later, kHangLimit);
  EXPECT_EQ(gone, 1);
  server->drain_and_stop();
  server.reset();
}

// The frame that hangs, and those of a second session that wait behind it.
TEST(DeviceHang, SessionsGoOnElsewhereWithTheSameBitsAndTheDaemonDrainsAndEndsWithOne) {
  const TemporaryFolder folder;
  const std::string keys = folder.path("keys");
  write_file(keys, "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n");
  ASSERT_EQ(chmod(keys.c_str(), S_IRUSR), 0);
  constexpr absl::Duration kDrain = absl::Seconds(30);
  Daemon hanging({"--listen", "127.0.0.1:0", "--resume-keys", keys, "--pre-drain", "10m", "--drain-timeout",
                  absl::FormatDuration(kDrain), "--executor", "device"},
                 HANGING_CANDELAD);
  Daemon good({"--listen", "127.0.0.1:0", "--resume-keys", keys, "--executor", "device"});
  const std::string first = hanging.wait_until_listening(), second = good.wait_until_listening();
  ASSERT_TRUE(first != "" && second != "") << hanging.errors() << good.errors();
  const Film film = make_film(24, 320, 180);
  SessionOptions options;
  options.servers = {second};
  const SessionRun whole = run_session(Session::open(options), film);
  ASSERT_OK(whole.status);

  options.servers = {first, second};
  SessionRun runs[2];
  {
    std::thread other([&] { runs[1] = run_session(Session::open(options), film); });
    runs[0] = run_session(Session::open(options), film);
    other.join();
  }
  const absl::Time resumed = absl::Now();
  for (const SessionRun& run : runs) {
    EXPECT_OK(run.status);
    EXPECT_TRUE(run.images == whole.images);
    EXPECT_EQ(run.stats.resumes, 1u);
  }
  EXPECT_EQ(hanging.wait(), 1);
  EXPECT_LT(absl::Now() - resumed, kDrain);
  EXPECT_TRUE(says(hanging.errors(), "the device hangs"));
  EXPECT_TRUE(says(hanging.errors(), "info stopped"));
}

TEST(DeviceHang, OneThatShowsDuringADrainDoesNotCutItShort) {
  Daemon hanging(
      {"--listen", "127.0.0.1:0", "--pre-drain", "0", "--drain-timeout", "2m", "--executor", "device"},
      HANGING_CANDELAD);
  SessionOptions options;
  options.servers = {hanging.wait_until_listening()};
  options.resume_limit = absl::ZeroDuration();
  std::atomic<size_t> results = 0;
  SessionRun run;
  std::thread client([&] {
    run = run_session(Session::open(options), make_film(24, 320, 180),
                      [&results](size_t count) { results = count; });
  });
  // Once frames stop, the device hangs.
  size_t seen = 0;
  const absl::Time end = absl::Now() + absl::Minutes(2);
  do {
    seen = results;
    absl::SleepFor(absl::Seconds(3));
  } while ((seen == 0 || seen != results) && absl::Now() < end);
  EXPECT_GT(seen, 0u);
  hanging.signal(SIGTERM);
  client.join();
  EXPECT_LT(results, 24u);
  EXPECT_REFUSED(kUnavailable, "", run.status);
  EXPECT_EQ(hanging.wait(), 1);
  EXPECT_TRUE(says(hanging.errors(), "the device hangs"));
  EXPECT_TRUE(says(hanging.errors(), "info stopped"));
  EXPECT_FALSE(says(hanging.errors(), "second signal"));
}

}  // namespace
}  // namespace candela::testing
