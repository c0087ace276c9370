// A session's driver gives servers the panoramas that they lack, in virtual time and in one thread.
#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "client/session_driver.h"
#include "tests/support/status.h"
#include "tests/unit/client/fake_calls.h"

namespace candela {
namespace {

SessionFrame view(uint64_t sequence, const std::string& environment) {
  SessionFrame view{.width = 1, .height = 1, .sequence = sequence};
  view.view.emplace().set_environment(environment);
  view.panorama = std::make_shared<const Panorama>();
  return view;
}

// A film of two views with panoramas of their own, and what a server says to a put.
struct Views {
  absl::Status status;
  std::vector<std::string> puts;  // servers' addresses
  size_t opens = 0;
};
Views run_views(size_t servers, const std::function<absl::StatusOr<std::string>(size_t server)>& put,
                const std::function<void(FakeSession&)>& arrange = nullptr) {
  testing::VirtualClock clock;
  FakeSession session(servers, SessionOptions(), clock);
  Views got;
  const SessionFrame views[] = {view(1, "sun"), view(2, "moon")};
  session.servers.on_put = [&](size_t server, const Panorama& panorama) -> absl::StatusOr<v1::Environment> {
    got.puts.push_back(session.servers.address(server));
    const absl::StatusOr<std::string> id = put(server);
    if (!id.ok()) return id.status();
    v1::Environment environment;
    environment.set_id(!id->empty() ? *id : &panorama == views[0].panorama.get() ? "sun" : "moon");
    return environment;
  };
  if (arrange) arrange(session);
  session.driver.start();
  session.settle();
  for (const SessionFrame& view : views) EXPECT_OK(session.state.submit(view));
  session.state.finish();
  while (session.step()) continue;
  EXPECT_TRUE(session.driver.ended());
  for (bool more = true; more;) {
    const absl::StatusOr<std::optional<FrameResult>> result = session.state.next_result();
    got.status = result.status();
    more = result.ok() && *result;
  }
  got.opens = session.servers.opens.size();
  return got;
}

absl::StatusOr<std::string> right(size_t) { return ""; }

TEST(SessionPanoramas, AServerWithoutAPanoramaGetsAllAndIsCalledAgain) {
  const Views got = run_views(2, right);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.puts, (std::vector<std::string>{"zero", "zero"}));
  EXPECT_EQ(got.opens, 2u);
}

TEST(SessionPanoramas, EachServerThatItResumesOnGetsThePanoramas) {
  const Views got = run_views(2, right, [](FakeSession& session) {
    session.servers.on_frame = [](size_t server, uint64_t) {
      return server == 0 ? grpc::Status(grpc::UNAVAILABLE, "lost") : grpc::Status::OK;
    };
  });
  EXPECT_OK(got.status);
  EXPECT_EQ(got.puts, (std::vector<std::string>{"zero", "zero", "one", "one"}));
}

TEST(SessionPanoramas, AServerThatForgetsThemAtOnceIsLeft) {
  const auto forgets = [](FakeSession& session) {
    session.servers.on_open = [&session](size_t server) {
      if (server == 0) session.servers.environments[server].clear();
      return grpc::Status::OK;
    };
  };
  const Views alone = run_views(1, right, forgets);
  EXPECT_REFUSED(kUnavailable, "no server has taken the session on for 30s: no environment sun",
                 alone.status);
  EXPECT_GT(alone.puts.size(), 4u) << "it is asked again until then";
  const Views moved = run_views(2, right, forgets);
  EXPECT_OK(moved.status);
  EXPECT_EQ(moved.puts, (std::vector<std::string>{"zero", "zero", "one", "one"}));
}

TEST(SessionPanoramas, AServerThatForgetsAPanoramaAfterAResultGetsItAgain) {
  const Views got = run_views(1, right, [](FakeSession& session) {
    session.servers.on_frame = [&session](size_t server, uint64_t sequence) {
      if (sequence == 1) session.servers.environments[server].clear();
      return grpc::Status::OK;
    };
  });
  EXPECT_OK(got.status);
  EXPECT_EQ(got.puts.size(), 3u) << "both, then the second one";
}

// With look-ahead the first view waits for the second one, so nothing comes between two calls that lack one.
TEST(SessionPanoramas, APanoramaOfALaterFrameIsPutAfterTheFirstFrames) {
  testing::VirtualClock clock;
  SessionOptions options;
  options.lookahead = 1;
  FakeSession session(1, options, clock);
  std::vector<std::string> puts;
  const SessionFrame views[] = {view(1, "sun"), view(2, "moon")};
  session.servers.on_put = [&](size_t, const Panorama& panorama) {
    v1::Environment environment;
    environment.set_id(&panorama == views[0].panorama.get() ? "sun" : "moon");
    puts.push_back(environment.id());
    return environment;
  };
  session.driver.start();
  session.settle();
  for (const SessionFrame& view : views) {
    EXPECT_OK(session.state.submit(view));
    session.settle();
  }
  session.state.finish();
  while (session.step()) continue;
  EXPECT_EQ(puts, (std::vector<std::string>{"sun", "moon"}));
  ASSERT_OK_AND_ASSIGN(const std::optional<FrameResult> result, session.state.next_result());
  EXPECT_TRUE(result);
}

TEST(SessionPanoramas, APutThatFailsEndsItUnlessAnotherServerMayHelp) {
  const Views moved = run_views(2, [](size_t server) -> absl::StatusOr<std::string> {
    if (server == 0) return absl::UnavailableError("gone");
    return "";
  });
  EXPECT_OK(moved.status);
  EXPECT_EQ(moved.puts, (std::vector<std::string>{"zero", "one", "one"}));
  const Views refused = run_views(2, [](size_t) { return absl::ResourceExhaustedError("too large"); });
  EXPECT_EQ(refused.status, absl::ResourceExhaustedError("too large"));
  const Views other = run_views(2, [](size_t) -> absl::StatusOr<std::string> { return "star"; });
  EXPECT_REFUSED(kInvalidArgument, "and that of its panorama star", other.status);
}

TEST(SessionPanoramas, CancelDuringAPutEndsItAfterThatPut) {
  FakeSession* cancelled = nullptr;
  const auto put = [&](size_t) -> absl::StatusOr<std::string> {
    cancelled->state.cancel();
    return "";
  };
  const Views got = run_views(1, put, [&](FakeSession& session) { cancelled = &session; });
  EXPECT_EQ(got.status, absl::CancelledError("the session was cancelled"));
  EXPECT_EQ(got.puts.size(), 1u);
}

}  // namespace
}  // namespace candela
