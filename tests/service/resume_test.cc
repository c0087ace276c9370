// Sessions that pause for longer than the server waits, and clients that repeat more than they have to.
#include <cstdlib>

#include "absl/time/clock.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/daemon.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr absl::Duration kIdleTimeout = absl::Seconds(1);

class Resume : public ::testing::Test {
 protected:
  Resume()
      : daemon_({"--listen", "127.0.0.1:0", "--idle-timeout", absl::FormatDuration(kIdleTimeout)},
                std::getenv("CANDELA_TEST_CANDELAD") == nullptr ? CANDELAD
                                                                : std::getenv("CANDELA_TEST_CANDELAD")),
        address_(daemon_.wait_until_listening()) {
    EXPECT_NE(address_, "") << daemon_.errors();
  }

  std::vector<StreamResult> undisturbed() const {
    return stream_all(own_channel(address_), open_of("undisturbed"), *film_);
  }
  // Sends frame `i` of the film and reads its answer.
  StreamResult one(StreamClient& client, size_t i) const {
    StreamResult result;
    EXPECT_TRUE(client.send(film_->at(i), i, film_time_ns(i)));
    EXPECT_TRUE(client.read(result)) << "frame " << i;
    return result;
  }

  Daemon daemon_;
  const std::string address_;
  const Film film_ = make_film(8, 160, 90);
};

TEST_F(Resume, ASessionThatPausedGoesOnWithItsToken) {
  const std::vector<StreamResult> expected = undisturbed();
  std::string token;
  for (size_t i = 0; i < film_->size(); i += 4) {
    StreamClient client(own_channel(address_), true, absl::Now() + absl::Seconds(30));
    ASSERT_TRUE(client.open("camera", {}, token));
    for (size_t k = i; k < i + 4; ++k) {
      const StreamResult result = one(client, k);
      EXPECT_TRUE(result.pixels == expected.at(k).pixels) << "frame " << k;
      EXPECT_EQ(result.header.exposure(), expected.at(k).header.exposure());
      token = result.token();
    }
    EXPECT_REFUSED(kUnavailable, "idle timeout", client.finish());
  }
}

// `lookahead` frames are held back when the pause begins.
void expect_a_camera_that_pauses_to_go_on(const std::string& address, const Film& film, uint32_t lookahead) {
  SessionOptions options;
  options.servers = {address};
  options.lookahead = lookahead;
  const SessionRun expected = run_session(Session::open(options), film);
  ASSERT_EQ(expected.images.size(), film->size()) << expected.status;
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options));
  std::vector<std::string> images;
  const auto take = [&] {
    const absl::StatusOr<std::optional<FrameResult>> result = session.next_result();
    ASSERT_TRUE(result.ok() && *result) << result.status();
    ASSERT_OK((*result)->status);
    images.emplace_back(reinterpret_cast<const char*>((*result)->image.data.get()), (*result)->image.bytes);
  };
  for (size_t i = 0; i < film->size(); ++i) {
    if (i == 4) absl::SleepFor(3 * kIdleTimeout);
    ASSERT_OK(session.submit(frame_of(film, i)));
    if (i >= lookahead) take();
  }
  session.finish();
  while (images.size() < film->size()) take();
  EXPECT_FALSE(session.next_result()->has_value());
  EXPECT_TRUE(images == expected.images);
  EXPECT_EQ(session.stats().resumes, 1u) << session.stats().last_loss;
}

TEST_F(Resume, TheClientLibraryGoesOnWhenItsCameraDoes) {
  expect_a_camera_that_pauses_to_go_on(address_, film_, 0);
}

TEST_F(Resume, TheClientLibraryGoesOnWithLookAheadToo) {
  expect_a_camera_that_pauses_to_go_on(address_, film_, 2);
}

TEST_F(Resume, APauseThatNothingFollowsEndsWell) {
  SessionOptions options;
  options.servers = {address_};
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options));
  ASSERT_OK(session.submit(frame_of(film_, 0)));
  EXPECT_TRUE(session.next_result()->has_value());
  absl::SleepFor(2 * kIdleTimeout);
  session.finish();
  const absl::StatusOr<std::optional<FrameResult>> end = session.next_result();
  EXPECT_TRUE(end.ok() && !*end) << end.status();
}

// A client that begins again too early: frames 1 and 2 come before the token's frame 3.
TEST_F(Resume, FramesBeforeTheTokensArePassedOver) {
  const std::vector<StreamResult> expected = undisturbed();
  std::string token;
  {
    StreamClient client(own_channel(address_));
    ASSERT_TRUE(client.open("again"));
    for (size_t i = 0; i < 4; ++i) token = one(client, i).token();
  }
  StreamClient client(own_channel(address_), true, absl::Now() + absl::Seconds(30));
  ASSERT_TRUE(client.open("again", {}, token));
  for (size_t i = 1; i < 3; ++i) {
    const StreamResult passed = one(client, i);
    EXPECT_TRUE(passed.failed);
    EXPECT_EQ(passed.failure.code(), static_cast<uint32_t>(grpc::ALREADY_EXISTS)) << passed.failure.message();
    EXPECT_EQ(passed.sequence(), i);
    token = passed.token();
  }
  for (size_t i = 3; i < 6; ++i) EXPECT_TRUE(one(client, i).pixels == expected.at(i).pixels) << "frame " << i;
  // Only what comes at the beginning may be a repetition.
  StreamResult result;
  client.send(film_->at(2), 2, film_time_ns(2));
  EXPECT_FALSE(client.read(result));
  EXPECT_EQ(client.finish().error_code(), grpc::INVALID_ARGUMENT);
  // The answer to a frame that was passed over carries a token as good as the one that it followed.
  StreamClient later(own_channel(address_), true, absl::Now() + absl::Seconds(30));
  ASSERT_TRUE(later.open("again-too", {}, token));
  EXPECT_EQ(later.finish().error_code(), grpc::FAILED_PRECONDITION);  // of another session
  StreamClient same(own_channel(address_), true, absl::Now() + absl::Seconds(30));
  ASSERT_TRUE(same.open("again", {}, token));
  EXPECT_TRUE(one(same, 4).pixels == expected.at(4).pixels);
}

}  // namespace
}  // namespace candela::testing
