// What a server says of its bits, and a lost device that comes back with others.
#include <gtest/gtest.h>

#include <set>

#include "server/device_keeper.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/stream_client.h"
#include "tests/support/clock/real_clock.h"
#include "tests/support/passes.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

absl::StatusOr<std::shared_ptr<RenderDevice>> open_device() {
  return open_render_device(DeviceOptions{}, uint64_t{64} << 20, real_clock(), executor_of_environment());
}

// A keeper whose device is opened again as `change` makes it.
struct Kept {
  explicit Kept(std::function<void(RenderDevice&)> change)
      : metrics("0", "device", "driver", "passes"),
        keeper(open_device().value(),
               [change = std::move(change)] {
                 absl::StatusOr<std::shared_ptr<RenderDevice>> opened = open_device();
                 if (opened.ok()) change(**opened);
                 return opened;
               },
               metrics, {.on_replaced = [this] { ++replaced; }, .on_gone = [this] { ++gone; }}) {}

  // The device is lost, and a frame fails because of it.
  void lose() {
    keeper.lose(1);
    keeper.job_ended(nullptr, absl::UnavailableError("device lost"));
  }

  Metrics metrics;
  int replaced = 0, gone = 0;
  DeviceKeeper keeper;
};

TEST(OtherBits, ADeviceThatComesBackWithItsBitsGoesOn) {
  Kept kept([](RenderDevice&) {});
  const std::string bits = kept.keeper.current()->bits;
  EXPECT_EQ(bits.size(), 16u);
  kept.lose();
  EXPECT_EQ(kept.replaced, 1);
  EXPECT_FALSE(kept.keeper.gone());
  EXPECT_EQ(kept.keeper.current()->bits, bits);
}

TEST(OtherBits, ADeviceThatComesBackWithOthersIsGivenUp) {
  Kept kept([](RenderDevice& device) { device.bits[0] = device.bits[0] == '0' ? '1' : '0'; });
  const std::shared_ptr<RenderDevice> first = kept.keeper.current();
  for (int i = 0; i < kMaxRebuilds; ++i) {
    EXPECT_FALSE(kept.keeper.gone());
    kept.lose();
  }
  kept.lose();
  EXPECT_TRUE(kept.keeper.gone());
  EXPECT_EQ(kept.gone, 1);
  EXPECT_EQ(kept.replaced, 0);
  EXPECT_EQ(kept.keeper.current(), first);
}

TEST(OtherBits, ServersOfOneKindSayTheSameInInfoAndSession) {
  std::set<std::string> said;
  for (int i = 0; i < 2; ++i) {
    const std::unique_ptr<Server> server = start_server(test_config());
    const auto channel = server->in_process_channel();
    said.insert(Connection(channel).server_info().value().device().bits());
    StreamClient client(channel);
    v1::StreamOpen open;
    open.set_session("shot");
    ASSERT_TRUE(client.open(open));
    client.half_close();
    EXPECT_TRUE(client.read_all().empty());
    said.insert(client.opened().bits());
  }
  EXPECT_EQ(said.size(), 1u);
  EXPECT_EQ(said.begin()->size(), 16u);
}

}  // namespace
}  // namespace candela::testing
