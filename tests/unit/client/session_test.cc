// The client's session against servers that fail on demand, over real connections. Every result arrives once,
// in order. Its waits are tested in virtual time, see session_driver_test.cc.
#include "client/session.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "absl/synchronization/notification.h"
#include "client/call/retry_schedule.h"
#include "tests/support/status.h"
#include "tests/unit/client/fake_server.h"

namespace candela {
namespace {

constexpr uint32_t kWidth = 700, kHeight = 500;  // two bands

v1::Settings at_ev(double ev) {
  v1::Settings settings;
  settings.mutable_exposure()->set_manual_ev(ev);
  return settings;
}

SessionFrame frame(uint64_t sequence) {
  static const auto pixels = std::make_shared<std::vector<std::byte>>(size_t{kWidth} * kHeight * 8);
  return {.width = kWidth,
          .height = kHeight,
          .format = v1::PIXEL_FORMAT_RGBA16F,
          .pixels = *pixels,
          .owner = pixels,
          .sequence = sequence,
          .media_time_ns = static_cast<int64_t>(sequence) * 1000};
}

SessionOptions options_for(std::vector<std::string> servers) {
  SessionOptions options;
  options.servers = std::move(servers);
  options.settings = at_ev(1);
  options.resume_limit = absl::Minutes(1);
  return options;
}

// Streams `frames` frames, with an EV of 2 from frame `change` on, and takes their results.
struct Outcome {
  absl::Status status;
  std::vector<int> values;  // a byte of each result, in the order they came; -1 for a failure
  SessionStats stats;
};
Outcome run(const SessionOptions& options, uint64_t frames, uint64_t change = 1000) {
  Outcome run;
  absl::StatusOr<Session> session = Session::open(options);
  if (!session.ok()) return {session.status(), {}, {}};
  std::thread feeder([&] {
    for (uint64_t i = 0; i < frames; ++i) {
      if (i == change && !session->change_settings(i, at_ev(2)).ok()) return;
      if (!session->submit(frame(i)).ok()) return;
    }
    session->finish();
  });
  while (true) {
    absl::StatusOr<std::optional<FrameResult>> result = session->next_result();
    run.status = result.status();
    if (!result.ok() || !*result) break;
    const FrameResult& r = **result;
    EXPECT_EQ(r.sequence, run.values.size());
    run.values.push_back(r.status.ok() ? static_cast<int>(r.image.pixels().back()) : -1);
  }
  feeder.join();
  run.stats = session->stats();
  return run;
}

std::vector<int> expected(uint64_t frames, uint64_t change = 1000) {
  std::vector<int> values;
  for (uint64_t i = 0; i < frames; ++i) values.push_back(static_cast<int>((i >= change ? 32 : 16) + i));
  return values;
}

TEST(Session, ResultsComeOnceAndInOrder) {
  FakeServer server;
  const Outcome got = run(options_for({server.address()}), 12, 7);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(12, 7));
  EXPECT_EQ(got.stats.resumes, 0u);
  EXPECT_EQ(got.stats.window, 2u);
  EXPECT_EQ(got.stats.answered, 12u);
  EXPECT_EQ(server.opens().at(0).resume_token(), "");
}

TEST(Session, ALostServerIsReplacedByTheNextWithTheLastTokenAndItsSettings) {
  FakeServer first([](uint64_t sequence, Wire&) {
    return sequence == 6 ? grpc::Status(grpc::UNAVAILABLE, "dying") : grpc::Status::OK;
  });
  FakeServer second;
  for (const uint64_t change : {3, 6, 7}) {
    const size_t before = second.opens().size();
    const Outcome got = run(options_for({first.address(), second.address()}), 12, change);
    EXPECT_OK(got.status);
    EXPECT_EQ(got.values, expected(12, change));
    EXPECT_EQ(got.stats.resumes, 1u);
    EXPECT_GE(got.stats.sent_again, 1u);
    EXPECT_EQ(got.stats.server, second.address());
    const v1::StreamOpen open = second.opens().at(before);
    EXPECT_EQ(open.resume_token(), "5");
    EXPECT_EQ(open.settings().exposure().manual_ev(), change <= 5 ? 2 : 1);
  }
}

TEST(Session, ACallThatEndsTooEarlyWithoutAnErrorIsLost) {
  FakeServer first(
      [](uint64_t sequence, Wire&) { return sequence == 3 ? FakeServer::kEndsAsIfDone : grpc::Status::OK; });
  FakeServer second;
  const Outcome outcome = run(options_for({first.address(), second.address()}), 8);
  ASSERT_OK(outcome.status);
  EXPECT_EQ(outcome.values.size(), 8u);
  EXPECT_EQ(outcome.stats.resumes, 1u);
}

TEST(Session, AStateOpensItAndATokenTakesItsPlace) {
  const auto with_state = [](uint64_t sequence, Wire& stream) {
    v1::StreamResponse response;
    v1::ResultHeader& header = *response.mutable_header();
    header.set_sequence(sequence);
    header.set_width(kWidth);
    header.set_height(kHeight);
    header.set_encoding(v1::ENCODING_NONE);
    header.set_resume_token("token");
    header.mutable_state()->set_sequence(sequence);
    stream.Write(response);
    return grpc::Status(grpc::UNAVAILABLE, "dying");
  };
  // The first server dies before its first result, and the others after it.
  FakeServer first([](uint64_t, Wire&) { return grpc::Status(grpc::UNAVAILABLE, "dying"); });
  FakeServer second(with_state), third(with_state);
  SessionOptions options = options_for({first.address(), second.address(), third.address()});
  options.encoding = v1::ENCODING_NONE;
  options.state.emplace().set_sequence(7);
  options.state->set_exposure(0.3);
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options));
  EXPECT_REFUSED(kInvalidArgument, "", session.submit(frame(7))) << "the state is of frame 7";
  ASSERT_OK(session.submit(frame(8)));
  ASSERT_OK(session.submit(frame(9)));
  session.finish();
  for (const uint64_t sequence : {8, 9}) {
    ASSERT_OK_AND_ASSIGN(const std::optional<FrameResult> result, session.next_result());
    EXPECT_EQ(result->sequence, sequence);
    EXPECT_EQ(result->image.header.state().sequence(), sequence);
    EXPECT_EQ(result->image.bytes, 0u);
  }
  EXPECT_EQ(first.opens().at(0).state().exposure(), 0.3);
  EXPECT_EQ(second.opens().at(0).state().exposure(), 0.3) << "there was no token yet";
  EXPECT_TRUE(second.opens().at(0).return_state());
  EXPECT_FALSE(third.opens().at(0).has_state());
  EXPECT_EQ(third.opens().at(0).resume_token(), "token");
}

TEST(Session, AServerThatIsTooOldForStatesOrExposuresIsNotBelieved) {
  FakeServer server;
  SessionOptions options = options_for({server.address()});
  options.return_state = true;
  const Outcome stateless = run(options, 3);
  EXPECT_REFUSED(kUnimplemented, "older than this client", stateless.status);
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options_for({server.address()})));
  SessionFrame exposed = frame(0);
  exposed.exposure = 0.0;
  EXPECT_TRUE(absl::IsInvalidArgument(session.submit(exposed)));
  exposed.exposure = 0.3;
  ASSERT_OK(session.submit(exposed));
  session.finish();
  EXPECT_TRUE(absl::IsUnimplemented(session.next_result().status()));
}

TEST(Session, AServerThatGoesAwayIsLeftInPeace) {
  FakeServer first([](uint64_t sequence, Wire& stream) {
    if (sequence != 4) return grpc::Status::OK;
    v1::StreamResponse response;
    response.mutable_go_away()->set_reason("draining");
    stream.Write(response);
    return grpc::Status(grpc::UNAVAILABLE, "drained");
  });
  FakeServer second;
  const Outcome got = run(options_for({first.address(), second.address()}), 9);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(9));
  EXPECT_EQ(got.stats.resumes, 1u);
}

TEST(Session, AFrameThatFailsIsAResultOfItsOwn) {
  FakeServer server([](uint64_t sequence, Wire& stream) {
    // This is the last frame: the answer that follows is one too many, so the call ends here.
    if (sequence != 3) return grpc::Status::OK;
    v1::StreamResponse response;
    response.mutable_failure()->set_sequence(3);
    response.mutable_failure()->set_code(grpc::DEADLINE_EXCEEDED);
    response.mutable_failure()->set_message("late");
    response.mutable_failure()->set_resume_token("3");
    stream.Write(response);
    return grpc::Status(grpc::RESOURCE_EXHAUSTED, "enough");
  });
  const Outcome got = run(options_for({server.address()}), 9);
  EXPECT_EQ(got.values, (std::vector<int>{16, 17, 18, -1}));
  EXPECT_EQ(got.status, absl::ResourceExhaustedError("enough"));
}

TEST(Session, ARefusalEndsItAfterWhatCameBefore) {
  FakeServer server([](uint64_t sequence, Wire&) {
    return sequence == 2 ? grpc::Status(grpc::INVALID_ARGUMENT, "no such frame") : grpc::Status::OK;
  });
  const Outcome got = run(options_for({server.address()}), 9);
  EXPECT_EQ(got.values, expected(2));
  EXPECT_EQ(got.status, absl::InvalidArgumentError("no such frame"));
  EXPECT_EQ(got.stats.resumes, 0u);
}

// The other call may be this session's previous one, if its open message came late. Once that has results, it
// is another session's.
TEST(Session, ACallThatIsTakenOverBeforeAResultGoesOn) {
  std::atomic<int> times = 0;
  FakeServer server([&](uint64_t sequence, Wire&) {
    if (sequence == 2 && times == 0) return grpc::Status(grpc::UNAVAILABLE, (++times, "lost"));
    if (sequence == 2 && times == 1) return grpc::Status(grpc::ABORTED, (++times, "another call"));
    if (sequence == 5) return grpc::Status(grpc::ABORTED, "another call");
    return grpc::Status::OK;
  });
  const Outcome got = run(options_for({server.address()}), 9);
  EXPECT_EQ(got.values, expected(5));
  EXPECT_EQ(got.status, absl::AbortedError("another call"));
  EXPECT_EQ(got.stats.resumes, 2u);
}

// google.rpc.Status { details { google.rpc.RetryInfo { retry_delay { seconds: 0 .. 127, nanos: 0.5e9 } } } }
std::string retry_details(int seconds) {
  const std::string type = "type.googleapis.com/google.rpc.RetryInfo";
  const std::string delay{'\x08', static_cast<char>(seconds), '\x10', '\x80', '\xca', '\xb5', '\xee', '\x01'};
  const std::string info = "\x0a\x08" + delay;
  const std::string any = "\x0a" + std::string(1, static_cast<char>(type.size())) + type + "\x12" +
                          std::string(1, static_cast<char>(info.size())) + info;
  return "\x08\x0e\x1a" + std::string(1, static_cast<char>(any.size())) + any;
}

TEST(Session, RetryInfoIsReadWhereItIs) {
  const auto delay_of = [](const std::string& details) {
    return retry_delay(grpc::Status(grpc::UNAVAILABLE, "busy", details));
  };
  EXPECT_EQ(delay_of(retry_details(0)), absl::Milliseconds(500));
  EXPECT_EQ(delay_of(retry_details(3)), absl::Milliseconds(3500));
  EXPECT_EQ(delay_of(""), absl::ZeroDuration());
  EXPECT_EQ(delay_of("no message"), absl::ZeroDuration());
  EXPECT_EQ(delay_of(retry_details(3).substr(0, 40)), absl::ZeroDuration());
}

TEST(Session, AnotherServerIsAskedAtOnce) {
  FakeServer first([](uint64_t sequence, Wire&) {
    return sequence == 2 ? grpc::Status(grpc::UNAVAILABLE, "busy", retry_details(60)) : grpc::Status::OK;
  });
  FakeServer second;
  const Outcome got = run(options_for({first.address(), second.address()}), 5);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(5));
  EXPECT_EQ(got.stats.server, second.address());
}

// The connection is still good.
TEST(Session, AServerThatHangsIsLeftForTheNext) {
  absl::Notification over;
  FakeServer first([&](uint64_t sequence, Wire&) {
    if (sequence == 4) over.WaitForNotification();
    return grpc::Status::OK;
  });
  FakeServer second;
  SessionOptions options = options_for({first.address(), second.address()});
  options.silence_limit = absl::Seconds(3);
  const Outcome got = run(options, 9);
  over.Notify();
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(9));
  EXPECT_EQ(got.stats.resumes, 1u);
  EXPECT_EQ(got.stats.server, second.address());
  EXPECT_EQ(second.opens().at(0).resume_token(), "3");
  EXPECT_TRUE(says(got.stats.last_loss.message(), "it hangs"));
}

TEST(Session, WithoutAnyServerItDoesNotOpen) {
  const Outcome got = run(options_for({"127.0.0.1:1", "127.0.0.1:2"}), 1);
  EXPECT_REFUSED(kUnavailable, "127.0.0.1:2", got.status);
  EXPECT_TRUE(absl::IsInvalidArgument(run(options_for({"nowhere"}), 1).status));
  EXPECT_TRUE(absl::IsInvalidArgument(run(options_for({}), 1).status));
}

TEST(Session, LeavingItAloneCancelsIt) {
  FakeServer server([](uint64_t, Wire&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return grpc::Status::OK;
  });
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options_for({server.address()})));
  EXPECT_OK(session.submit(frame(0)));
  EXPECT_OK(session.submit(frame(1)));
  EXPECT_FALSE(session.ready());
}

TEST(Session, FramesOutOfOrderAreRefusedAndItGoesOn) {
  FakeServer server;
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options_for({server.address()})));
  EXPECT_OK(session.submit(frame(5)));
  EXPECT_TRUE(absl::IsInvalidArgument(session.submit(frame(5))));
  SessionFrame early = frame(6);
  early.media_time_ns = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(session.submit(early)));
  SessionFrame small = frame(6);
  small.width = 1;
  EXPECT_TRUE(absl::IsInvalidArgument(session.submit(small)));
  EXPECT_TRUE(absl::IsInvalidArgument(session.change_settings(5, {})));
  for (int i = 0; i < 16; ++i) EXPECT_OK(session.change_settings(6, {}));
  EXPECT_TRUE(absl::IsFailedPrecondition(session.change_settings(6, {})));
  session.finish();
  EXPECT_TRUE(absl::IsFailedPrecondition(session.submit(frame(7))));
  absl::StatusOr<std::optional<FrameResult>> result = session.next_result();
  ASSERT_TRUE(result.ok() && *result) << result.status();
  EXPECT_EQ((**result).sequence, 5u);
  result = session.next_result();
  EXPECT_TRUE(result.ok() && !*result) << result.status();
}

}  // namespace
}  // namespace candela
