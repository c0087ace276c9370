// A session that moves between a server with the device's passes and one with the host's.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <bit>
#include <cstdlib>
#include <thread>

#include "tests/service/service_fixture.h"
#include "tests/service/sessions/stream_client.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

class PassesMoved : public ::testing::Test {
 protected:
  void SetUp() override {
    Config config = test_config();
    config.resume_keys = folder_.path("keys");
    write_file(config.resume_keys, "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n");
    ASSERT_EQ(chmod(config.resume_keys.c_str(), S_IRUSR), 0);
    config.executor = ExecutorKind::kDevice;
    device_ = start_server(config);
    config.executor = ExecutorKind::kHost;
    absl::StatusOr<std::unique_ptr<Server>> host = Server::start(config, real_clock(), alarm_timers());
    if (absl::IsFailedPrecondition(host.status())) GTEST_SKIP() << host.status();
    ASSERT_OK(host);
    host_ = *std::move(host);
  }

  static v1::DeviceInfo device_of(Server& server) {
    return Connection(server.in_process_channel())
        .server_info(absl::Now() + absl::Seconds(10))
        .value()
        .device();
  }

  TemporaryFolder folder_;
  std::unique_ptr<Server> device_;
  std::unique_ptr<Server> host_;
};

std::vector<WireFrame> brightening() {
  std::vector<WireFrame> frames;
  for (uint32_t i = 0; i < 6; ++i) {
    const float light = std::exp2(static_cast<float>(i) - 2.0f);
    frames.push_back(make_frame(97, 41, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) {
      Texel t = scenes::natural(97, 41)(x, y);
      for (size_t k = 0; k < 3; ++k) t[k] *= light;
      return t;
    }));
  }
  return frames;
}

// The answers of the frames from `first` on.
std::vector<StreamResult> go_on(Server& server, v1::StreamOpen open, const std::vector<WireFrame>& frames,
                                size_t first) {
  StreamClient client(server.in_process_channel());
  EXPECT_TRUE(client.open(open));
  std::thread writer([&] {
    for (size_t i = first; i < frames.size(); ++i) client.send(frames[i], i, film_time_ns(i));
    client.half_close();
  });
  std::vector<StreamResult> results = client.read_all();
  writer.join();
  EXPECT_OK(client.finish());
  return results;
}

TEST_F(PassesMoved, KeepsItsExposuresAndItsPixelsWithinACode) {
  EXPECT_EQ(device_of(*device_).passes(), "device");
  EXPECT_EQ(device_of(*host_).passes(), "host");
  EXPECT_NE(device_of(*device_).bits(), device_of(*host_).bits());
  const std::vector<WireFrame> frames = brightening();
  v1::StreamOpen open;
  open.set_session("moving");
  for (Server* const first : {device_.get(), host_.get()}) {
    Server& second = first == device_.get() ? *host_ : *device_;
    open.set_resume_token("");
    const std::vector<StreamResult> whole = go_on(*first, open, frames, 0);
    ASSERT_EQ(whole.size(), frames.size());
    open.set_resume_token(whole[2].token());
    const std::vector<StreamResult> rest = go_on(second, open, frames, 3);
    ASSERT_EQ(rest.size(), frames.size() - 3);
    for (size_t i = 0; i < rest.size(); ++i) {
      const StreamResult& there = whole[3 + i];
      EXPECT_EQ(std::bit_cast<uint64_t>(rest[i].header.exposure()),
                std::bit_cast<uint64_t>(there.header.exposure()));
      ASSERT_EQ(rest[i].pixels.size(), there.pixels.size());
      for (size_t k = 0; k < there.pixels.size(); ++k) {
        ASSERT_LE(std::abs(static_cast<uint8_t>(rest[i].pixels[k]) - static_cast<uint8_t>(there.pixels[k])),
                  1);
      }
    }
  }
}

}  // namespace
}  // namespace candela::testing
