// Sessions whose frames are views of environments.
#include <algorithm>
#include <functional>
#include <optional>

#include "absl/time/clock.h"
#include "client/session.h"
#include "tests/service/environments/environment_fixture.h"
#include "tests/service/server/scrape.h"
#include "tests/service/sessions/session_run.h"
#include "tests/service/sessions/stream_client.h"
#include "tests/support/files.h"

namespace candela::testing {
namespace {

class EnvironmentSession : public EnvironmentService {
 protected:
  absl::StatusOr<Session> open(const SessionOptions& options = {}) const {
    return Session::open({channel()}, options);
  }
};

// A camera that turns over the panorama, one frame in three from pixels.
SessionRun turn(absl::StatusOr<Session> session, const std::shared_ptr<const Panorama>& panorama, bool bring,
                const std::function<void(size_t)>& on_result = {}) {
  const auto pixels = std::make_shared<std::vector<HalfTexel>>(24 * 16, HalfTexel{0.5f, 0.25f, 1.0f, 1.0f});
  const auto frame_at = [&](size_t i) {
    SessionFrame frame{.width = 24, .height = 16, .sequence = i, .media_time_ns = film_time_ns(i)};
    if (i % 3 == 2) {
      frame.pixels = std::as_bytes(std::span(*pixels));
      frame.owner = pixels;
    } else {
      frame.view = view_of(environment_id(*panorama), 15.0 * static_cast<double>(i));
      if (bring) frame.panorama = panorama;
    }
    return frame;
  };
  return run_frames(std::move(session), 0, 24, frame_at, on_result);
}

TEST_F(EnvironmentSession, ASessionMixesViewsAndPixelsAndAdaptsToBoth) {
  const auto panorama = two_halves();
  put(*panorama);
  const SessionRun shown = turn(open(), panorama, false);
  ASSERT_OK(shown.status);
  ASSERT_EQ(shown.images.size(), 24u);
  const std::vector<double> exposures = shown.exposures();
  EXPECT_NE(exposures.front(), exposures.back());
  // Frame 6 looks to the right, where it is bright, and frame 18 to the left. Each is between two views.
  const size_t bright = 6, dark = 18;
  EXPECT_GT(shown.headers[dark].target(), 100 * shown.headers[bright].target());
  EXPECT_GT(exposures[dark], 1.1 * exposures[bright]);
  for (const size_t i : {bright, dark}) {
    const double before = exposures[i - 1], target = shown.headers[i].target();
    EXPECT_GE(exposures[i], std::min(before, target)) << i;
    EXPECT_LE(exposures[i], std::max(before, target)) << i;
    EXPECT_NE(exposures[i], target) << i;
  }
  const SessionRun again = turn(open(), panorama, false);
  EXPECT_EQ(shown.images, again.images);
  EXPECT_EQ(exposures, again.exposures());
}

TEST_F(EnvironmentSession, ASessionEndsBeforeAViewOfWhatTheServerDoesNotHave) {
  const auto panorama = two_halves();
  const SessionRun shown = turn(open(), panorama, false);
  EXPECT_REFUSED(kNotFound, environment_id(*panorama), shown.status);
  EXPECT_TRUE(shown.images.empty());
}

TEST_F(EnvironmentSession, AFrameBeforeAViewOfWhatTheServerDoesNotHaveGetsItsResult) {
  const std::string id = environment_id(*two_halves());
  ASSERT_OK_AND_ASSIGN(Session session, open());
  const std::vector<HalfTexel> pixels(24 * 16, HalfTexel{0.5f, 0.25f, 1.0f, 1.0f});
  SessionFrame frame{.width = 24, .height = 16, .pixels = std::as_bytes(std::span(pixels))};
  ASSERT_OK(session.submit(frame));
  frame = {.width = 24, .height = 16, .sequence = 1, .media_time_ns = film_time_ns(1)};
  frame.view = view_of(id);
  ASSERT_OK(session.submit(frame));
  ASSERT_OK_AND_ASSIGN(const std::optional<FrameResult> first, session.next_result());
  ASSERT_TRUE(first.has_value());
  EXPECT_OK(first->status);
  EXPECT_GT(first->image.bytes, 0u);
  EXPECT_REFUSED(kNotFound, id, session.next_result());
}

TEST_F(EnvironmentSession, ASessionBringsItsPanoramaToAServerThatNeverSawIt) {
  const auto panorama = two_halves();
  const SessionRun shown = turn(open(), panorama, true);
  ASSERT_OK(shown.status);
  put(*panorama);
  const SessionRun there = turn(open(), panorama, false);
  EXPECT_EQ(shown.images, there.images);
}

// The environment goes while the session runs, as with a lost device or another server.
TEST_F(EnvironmentSession, ASessionThatLosesItsServerGoesOnElsewhereWithTheSameBits) {
  const auto panorama = two_halves();
  Config config = test_config();
  const TemporaryFile keys("00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff\n");
  config.resume_keys = keys.path();
  restart(config);
  put(*panorama);
  const SessionRun whole = turn(open(), panorama, true);
  ASSERT_OK(whole.status);

  // It moves twice, because the second move must find the panorama missing as the first one did.
  const std::unique_ptr<Server> second = start_server(config), third = start_server(config);
  SessionOptions options;
  options.servers = {server_->addresses().front(), second->addresses().front(), third->addresses().front()};
  const SessionRun moved = turn(Session::open(options), panorama, true, [&](size_t results) {
    if (results == 6) server_->drain_and_stop();
    if (results == 14) second->drain_and_stop();
  });
  ASSERT_OK(moved.status);
  EXPECT_GE(moved.stats.resumes, 2u);
  EXPECT_EQ(moved.images, whole.images);
  EXPECT_EQ(moved.exposures(), whole.exposures());
}

TEST_F(EnvironmentSession, WorksWithLookAhead) {
  const auto panorama = two_halves();
  put(*panorama);
  SessionOptions options;
  options.lookahead = 3;
  const SessionRun shown = turn(open(options), panorama, false);
  EXPECT_OK(shown.status);
  EXPECT_EQ(shown.images.size(), 24u);
}

TEST_F(EnvironmentSession, ThoseOfALostDeviceGoWithIt) {
  Config config = test_config();
  config.metrics = "127.0.0.1:0";
  restart(config);
  const auto panorama = two_halves();
  ASSERT_OK_AND_ASSIGN(const v1::Environment kept, connection().put_environment(*panorama));
  EXPECT_EQ(scrape(*server_).at("candela_environment_bytes"), kept.memory_bytes());
  server_->lose_device();
  EXPECT_REFUSED(kUnavailable, "", connection().render({}, frame_of(view_of(kept.id()))));
  EXPECT_REFUSED(kNotFound, "", connection().get_environment(kept.id()));
  // The call that failed was the last to use it.
  const absl::Time end = absl::Now() + absl::Seconds(10);
  while (scrape(*server_).at("candela_environment_bytes") > 0 && absl::Now() < end) {
    absl::SleepFor(absl::Milliseconds(10));
  }
  EXPECT_EQ(scrape(*server_).at("candela_environment_bytes"), 0);
  const SessionRun shown = turn(open(), panorama, true);
  EXPECT_OK(shown.status);
}

}  // namespace
}  // namespace candela::testing
