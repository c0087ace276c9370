// A session's driver, in virtual time and without connections.
#include "client/session_driver.h"

#include <gtest/gtest.h>

#include <deque>
#include <functional>
#include <iterator>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "client/call/link_pace.h"
#include "client/call/retry_schedule.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/check.h"
#include "tests/support/clock.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class FakeCall;

// They answer as FakeServer does, and each holds back the results that look-ahead needs.
class FakeServers final : public SessionServers {
 public:
  // What a server does with an open message or a frame. OK: as it should. kSilent: nothing, from now on.
  // Another status ends the call.
  std::function<grpc::Status(size_t server)> on_open = [](size_t) { return grpc::Status::OK; };
  std::function<grpc::Status(size_t server, uint64_t sequence)> on_frame = [](size_t, uint64_t) {
    return grpc::Status::OK;
  };
  std::function<absl::StatusOr<v1::Environment>(size_t server, const Panorama& panorama)> on_put;
  static inline const grpc::Status kSilent{grpc::OUT_OF_RANGE, "silent"};

  struct Open {
    size_t server;
    absl::Time when;
    v1::StreamOpen message;
  };
  std::vector<Open> opens;
  std::vector<std::set<std::string>> environments;  // of each server, by their ids
  std::set<size_t> unreachable;
  FakeCall* call_now = nullptr;

  FakeServers(size_t count, Clock& clock) : environments(count), clock_(clock) {}

  size_t count() const override { return environments.size(); }
  const std::string& address(size_t server) const override { return addresses_[server]; }
  std::unique_ptr<ClientCall> call(size_t server, const std::string& session) override;
  void put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time deadline) override;

  grpc::Status open(size_t server, const v1::StreamOpen& message);
  // Passes on an answer or the next event of the call. False: there is none.
  bool pass_on(SessionDriver& driver);

 private:
  const std::vector<std::string> addresses_{"zero", "one", "two"};
  Clock& clock_;
  std::function<absl::StatusOr<v1::Environment>()> put_;
};

// A session on such servers. The test is its caller and its thread.
class FakeSession {
 public:
  FakeSession(size_t servers, SessionOptions options, testing::VirtualClock& clock);

  // Passes on the next event, if need be by going on to the driver's deadline. False: there is none, or the
  // session has ended.
  bool step();
  // Passes on events while there are any without waiting.
  void settle();

  testing::VirtualClock& clock;
  const SessionOptions options;
  const std::string name = "session";
  FakeServers servers;
  bool woken = false;
  SessionState state;
  SessionMemory memory{Transport::kGrpc};
  SessionDriver driver;
};

// One call to one of them.
class FakeCall final : public ClientCall {
 public:
  FakeCall(FakeServers& servers, size_t server);
  ~FakeCall() override { servers_.call_now = nullptr; }

  bool can_write() const override { return started_ && !writing_ && !end_; }
  bool writing() const override { return writing_; }
  void write(const grpc::ByteBuffer& message) override;
  void half_close() override;
  grpc::ByteBuffer& message() override { return message_; }
  void read() override;
  void cancel() override { lose({grpc::CANCELLED, "cancelled"}); }
  const grpc::Status& status() const override { return *end_; }
  bool connected() const override { return connected_; }
  absl::Status error() const override;

  // What the server sent and the client has not read is lost.
  void lose(const grpc::Status& status);
  std::optional<CallEvent> next();

 private:
  void take();
  void take_frame(const v1::FrameHeader& frame);
  void answer_held(size_t but);
  void act(const grpc::Status& what, const std::function<void()>& well);

  FakeServers& servers_;
  const size_t server_;
  bool started_ = false;
  bool writing_ = false;
  bool reading_ = true;
  bool connected_ = false;
  bool silent_ = false;
  std::optional<grpc::ByteBuffer> sent_;  // on its way; none: the half-close
  grpc::ByteBuffer message_;
  std::deque<grpc::ByteBuffer> inbox_;
  std::optional<grpc::Status> end_;
  v1::StreamOpen open_;
  std::map<uint64_t, v1::Settings> settings_;
  v1::FrameHeader frame_;               // whose pixels come
  std::deque<v1::FrameHeader> frames_;  // that have no answer
};

std::unique_ptr<ClientCall> FakeServers::call(size_t server, const std::string&) {
  CHECK(call_now == nullptr);  // one call at a time
  auto call = std::make_unique<FakeCall>(*this, server);
  call_now = call.get();
  return call;
}

void FakeServers::put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time) {
  CHECK(!put_ && call_now == nullptr);
  put_ = [this, server, panorama = std::move(panorama)] {
    absl::StatusOr<v1::Environment> put = on_put(server, *panorama);
    if (put.ok()) environments[server].insert(put->id());
    return put;
  };
}

grpc::Status FakeServers::open(size_t server, const v1::StreamOpen& message) {
  opens.push_back({server, clock_.now(), message});
  return on_open(server);
}

bool FakeServers::pass_on(SessionDriver& driver) {
  if (put_) {
    driver.on_put(std::exchange(put_, nullptr)());
    return true;
  }
  const std::optional<CallEvent> event = call_now == nullptr ? std::nullopt : call_now->next();
  if (event) driver.on_event(*event);
  return event.has_value();
}

FakeSession::FakeSession(size_t count, SessionOptions wanted, testing::VirtualClock& time)
    : clock(time),
      options(std::move(wanted)),
      servers(count, clock),
      state(options, servers.address(0), clock, [this] { woken = true; }),
      driver(servers, options, name, state, memory, clock, 1) {}

bool FakeSession::step() {
  if (driver.ended()) return false;
  if (std::exchange(woken, false)) {
    driver.on_event(CallEvent::kWoken);
    return true;
  }
  if (servers.pass_on(driver)) return true;
  const absl::Time deadline = driver.deadline();
  if (deadline == absl::InfiniteFuture()) return false;
  if (deadline > clock.now()) clock.advance(deadline - clock.now());
  driver.on_event(CallEvent::kTimeout);
  return true;
}

void FakeSession::settle() {
  for (bool any = true; any && !driver.ended();) {
    any = std::exchange(woken, false);
    if (any) driver.on_event(CallEvent::kWoken);
    any |= servers.pass_on(driver);
  }
}

FakeCall::FakeCall(FakeServers& servers, size_t server) : servers_(servers), server_(server) {
  if (servers.unreachable.contains(server)) end_ = grpc::Status(grpc::UNAVAILABLE, "cannot reach");
}

void FakeCall::write(const grpc::ByteBuffer& message) {
  CHECK(can_write());
  writing_ = true;
  sent_ = message;
}

void FakeCall::half_close() {
  CHECK(can_write());
  writing_ = true;
  sent_.reset();
}

void FakeCall::read() {
  CHECK(!reading_);
  reading_ = true;
}

absl::Status FakeCall::error() const {
  return {static_cast<absl::StatusCode>(end_->error_code()), end_->error_message()};
}

void FakeCall::lose(const grpc::Status& status) {
  inbox_.clear();
  if (!end_) end_ = status;
}

std::optional<CallEvent> FakeCall::next() {
  if (!started_ || writing_) {
    if (std::exchange(writing_, false) && !end_) take();
    started_ = true;
    return CallEvent::kWritable;
  }
  if (!reading_) return std::nullopt;
  if (!inbox_.empty()) {
    message_ = std::move(inbox_.front());
    inbox_.pop_front();
    reading_ = false;
    return CallEvent::kMessage;
  }
  if (end_) return CallEvent::kEnded;
  return std::nullopt;
}

// The server reads what was sent.
void FakeCall::take() {
  connected_ = true;
  if (silent_) return;
  if (!sent_) {
    answer_held(0);
    if (!end_) end_ = grpc::Status::OK;
    return;
  }
  v1::StreamRequest request;
  CHECK(v1::unpack(*sent_, request));
  if (request.has_open()) {
    open_ = request.open();
    settings_[0] = open_.settings();
    act(servers_.open(server_, open_), [this] {
      v1::StreamResponse opened;
      opened.mutable_opened()->set_session(open_.session());
      opened.mutable_opened()->set_max_frames_in_flight(2);
      inbox_.push_back(v1::pack(opened));
    });
  } else if (request.has_change()) {
    settings_[request.change().from_sequence()] = request.change().settings();
  } else if (request.has_frame()) {
    frame_ = request.frame();
    if (frame_.has_view()) take_frame(frame_);
  } else {
    CHECK(request.has_band());
    take_frame(frame_);
  }
}

void FakeCall::take_frame(const v1::FrameHeader& frame) {
  if (frame.has_view() && !servers_.environments[server_].contains(frame.view().environment())) {
    end_ = grpc::Status(grpc::NOT_FOUND, "no environment " + frame.view().environment());
    return;
  }
  frames_.push_back(frame);
  answer_held(open_.lookahead());
}

// Answers the oldest frames, but not the last `but` ones.
void FakeCall::answer_held(size_t but) {
  while (frames_.size() > but && !end_ && !silent_) {
    const v1::FrameHeader frame = std::move(frames_.front());
    frames_.pop_front();
    act(servers_.on_frame(server_, frame.sequence()), [&] {
      v1::StreamResponse response;
      v1::ResultHeader& header = *response.mutable_header();
      header.set_sequence(frame.sequence());
      header.set_width(frame.width());
      header.set_height(frame.height());
      header.set_format(v1::OUTPUT_FORMAT_RGBA8);
      header.set_resume_token(std::to_string(frame.sequence()));
      inbox_.push_back(v1::pack(response));
      const v1::Settings& settings = std::prev(settings_.upper_bound(frame.sequence()))->second;
      const auto value =
          static_cast<char>(16 * settings.exposure().manual_ev() + static_cast<double>(frame.sequence()));
      response.mutable_band()->set_first_row(0);
      response.mutable_band()->set_pixels(std::string(size_t{frame.width()} * frame.height() * 4, value));
      inbox_.push_back(v1::pack(response));
    });
  }
}

void FakeCall::act(const grpc::Status& what, const std::function<void()>& well) {
  if (what.ok()) return well();
  silent_ = what.error_message() == FakeServers::kSilent.error_message();
  if (!silent_) end_ = what;
}

// A film for a session on servers that a test makes up, and what came of it.

const grpc::Status kLost{grpc::UNAVAILABLE, "lost"};

v1::Settings at_ev(double ev) {
  v1::Settings settings;
  settings.mutable_exposure()->set_manual_ev(ev);
  return settings;
}

SessionFrame frame(uint64_t sequence) {
  static const std::vector<std::byte> pixel(8);
  return {.width = 1,
          .height = 1,
          .pixels = pixel,
          .sequence = sequence,
          .media_time_ns = static_cast<int64_t>(sequence) * 1000};
}

SessionOptions options() {
  SessionOptions options;
  options.settings = at_ev(1);
  options.resume_limit = absl::Seconds(5);
  options.silence_limit = absl::Minutes(1);
  return options;
}

// google.rpc.Status with a google.rpc.RetryInfo of so many seconds, up to 127.
grpc::Status full(int seconds) {
  const std::string type = "type.googleapis.com/google.rpc.RetryInfo";
  const std::string info{'\x0a', '\x02', '\x08', static_cast<char>(seconds)};
  const std::string any = "\x0a" + std::string(1, static_cast<char>(type.size())) + type + "\x12" +
                          std::string(1, static_cast<char>(info.size())) + info;
  return {grpc::UNAVAILABLE, "full", "\x08\x0e\x1a" + std::string(1, static_cast<char>(any.size())) + any};
}

struct Outcome {
  absl::Status status = absl::InternalError("it stands still");
  std::vector<int> values;  // a byte of each result, in the order they came
  int events = 0;           // that were passed on
  SessionStats stats;
};

// Submits `frames` frames, with an EV of 2 from frame `change` on, and takes their results. `before` is
// called before each event, with its number.
Outcome run(FakeSession& session, uint64_t frames, uint64_t change = 1000,
            const std::function<void(int event)>& before = nullptr) {
  Outcome run;
  session.driver.start();
  uint64_t next = 0;
  for (bool going = true, finished = false; going;) {
    while (session.state.was_open() && next < frames && session.state.ready()) {
      if (next == change && !session.state.change_settings(next, at_ev(2)).ok()) break;
      if (!session.state.submit(frame(next)).ok()) break;
      ++next;
    }
    if (next == frames && !finished) {
      finished = true;
      session.state.finish();
    }
    if (before) before(run.events);
    going = session.step();
    run.events += going;
    while (session.state.result_ready()) {
      const absl::StatusOr<std::optional<FrameResult>> result = session.state.next_result();
      run.status = result.status();
      if (!result.ok() || !*result) break;
      EXPECT_EQ((**result).sequence, run.values.size());
      run.values.push_back(static_cast<int>((**result).image.pixels().back()));
    }
  }
  run.stats = session.state.stats();
  EXPECT_TRUE(session.driver.ended());
  EXPECT_EQ(session.servers.call_now, nullptr);
  return run;
}

std::vector<int> expected(uint64_t frames, uint64_t change = 1000) {
  std::vector<int> values;
  for (uint64_t i = 0; i < frames; ++i) values.push_back(static_cast<int>((i >= change ? 32 : 16) + i));
  return values;
}

// What a session knows of its servers, without a call.

TEST(SessionState, TellsWhetherItsServersRenderTheSameBits) {
  struct Row {
    std::vector<std::string> bits;  // of each server; "": it does not say
    bool mixed;
  };
  for (const auto& [bits, mixed] :
       {Row{{"aa"}, false}, Row{{"aa", "aa"}, false}, Row{{"aa", "bb"}, true}, Row{{"aa", "bb", "aa"}, true},
        Row{{"aa", ""}, false}, Row{{"", "bb"}, false}, Row{{"aa", "", "aa"}, false},
        Row{{"aa", "", "bb"}, true}}) {
    testing::VirtualClock clock;
    SessionState state({}, "first", clock, [] {});
    EXPECT_FALSE(state.stats().mixed_bits);
    for (const std::string& server : bits) {
      v1::StreamOpened opened;
      opened.set_bits(server);
      state.take_open(opened);
    }
    EXPECT_EQ(state.stats().resumes, bits.size() - 1);
    EXPECT_EQ(state.stats().mixed_bits, mixed) << ::testing::PrintToString(bits);
  }
}

// How long a session waits for servers that do not take it, in virtual time.

using testing::VirtualClock;

TEST(SessionOpen, AFullServerIsAskedWhenItSaysAndNotBefore) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  bool was_full = false;
  session.servers.on_frame = [&](size_t, uint64_t sequence) {
    return sequence == 2 && !std::exchange(was_full, true) ? full(3) : grpc::Status::OK;
  };
  const Outcome got = run(session, 5);
  EXPECT_EQ(got.values, expected(5));
  ASSERT_EQ(session.servers.opens.size(), 2u);
  const absl::Duration wait = session.servers.opens[1].when - session.servers.opens[0].when;
  EXPECT_GE(wait, absl::Seconds(3));
  EXPECT_LE(wait, absl::Seconds(4.5));
  EXPECT_EQ(got.stats.time_without_results, wait);
}

TEST(SessionOpen, AServerThatWantsToBeLeftAloneForTooLongIsNotAskedAgain) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  const absl::Time begin = clock.now();
  session.servers.on_frame = [](size_t, uint64_t) { return full(60); };
  EXPECT_REFUSED(kUnavailable, "for 5s: full", run(session, 5).status);
  EXPECT_EQ(session.servers.opens.size(), 1u);
  EXPECT_EQ(clock.now() - begin, absl::Seconds(5));
}

TEST(SessionOpen, AFullServerIsWaitedForBeforeTheFirstOpen) {
  VirtualClock clock;
  SessionOptions wanted = options();
  std::vector<std::string> waits;  // the servers that failed last
  wanted.on_open_wait = [&](const std::string& server, const absl::Status& why) {
    EXPECT_EQ(why.message(), "full");
    waits.push_back(server);
  };
  FakeSession session(2, wanted, clock);
  session.servers.on_open = [&](size_t) {
    return session.servers.opens.size() < 5 ? full(1) : grpc::Status::OK;
  };
  const Outcome got = run(session, 5);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.stats.resumes, 0u);
  EXPECT_EQ(waits, (std::vector<std::string>{"one", "zero", "one"}));
  const std::vector<FakeServers::Open>& opens = session.servers.opens;
  EXPECT_EQ(opens.at(1).when, opens.at(0).when) << "another server is asked at once";
  for (size_t i = 2; i < opens.size(); ++i) EXPECT_GE(opens[i].when - opens[i - 2].when, absl::Seconds(1));
}

TEST(SessionOpen, TheFirstOpenHasALimitAndZeroMeansOnce) {
  for (const absl::Duration limit : {absl::Seconds(2), absl::ZeroDuration()}) {
    VirtualClock clock;
    SessionOptions wanted = options();
    wanted.resume_limit = limit;
    FakeSession session(1, wanted, clock);
    const absl::Time begin = clock.now();
    session.servers.on_open = [](size_t) { return full(1); };
    const bool once = limit == absl::ZeroDuration();
    EXPECT_EQ(run(session, 1).status.message(),
              once ? "full" : "no server opens the session within 2s: full");
    EXPECT_EQ(session.servers.opens.size() == 1, once);
    EXPECT_LE(clock.now() - begin, limit);
  }
}

TEST(SessionOpen, ServersThatCannotBeReachedAreWaitedForOnlyBesideOneThatIsFull) {
  for (const bool any : {false, true}) {
    VirtualClock clock;
    FakeSession session(2, options(), clock);
    const absl::Time begin = clock.now();
    session.servers.unreachable = {1};
    if (!any) session.servers.unreachable.insert(0);
    session.servers.on_open = [&](size_t) {
      return session.servers.opens.size() < 2 ? full(1) : grpc::Status::OK;
    };
    const Outcome got = run(session, 3);
    EXPECT_EQ(got.status, any ? absl::OkStatus() : absl::UnavailableError("cannot reach"));
    EXPECT_EQ(got.events, any ? got.events : 4) << "a beginning and an end for each";
    EXPECT_EQ(clock.now() > begin, any);
  }
}

TEST(SessionOpen, ANameThatItsOwnLostCallMayHoldIsWaitedFor) {
  for (const bool own : {true, false}) {
    VirtualClock clock;
    FakeSession session(1, options(), clock);
    session.servers.on_open = [&](size_t) {
      const size_t opens = session.servers.opens.size();
      if (own && opens == 1) return kLost;
      return opens < 4 ? grpc::Status(grpc::ALREADY_EXISTS, "open on another call") : grpc::Status::OK;
    };
    EXPECT_EQ(run(session, 2).status,
              own ? absl::OkStatus() : absl::AlreadyExistsError("open on another call"));
    EXPECT_EQ(session.servers.opens.size(), own ? 4u : 1u);
  }
}

TEST(SessionOpen, AnOpenMessageThatComesTooLateIsSentAgain) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  session.servers.on_open = [&](size_t) {
    const bool late = session.servers.opens.size() < 3;
    return late ? grpc::Status(grpc::DEADLINE_EXCEEDED, "nothing arrived") : grpc::Status::OK;
  };
  EXPECT_OK(run(session, 2).status);
  EXPECT_EQ(session.servers.opens.size(), 3u);
}

// A session's driver gives servers the panoramas that they lack, in virtual time and in one thread.

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

constexpr uint64_t kBand = 2 << 20;

// Sends a frame of `bands` over a link of so many bytes a second. Returns whether it was compressed.
bool send(LinkPace& pace, double bytes_per_second, uint64_t bands = 8) {
  const bool compressed = pace.next_frame();
  for (uint64_t i = 0; !compressed && i + 1 < bands; ++i) {
    pace.wrote(i, kBand, absl::Seconds(static_cast<double>(kBand) / bytes_per_second));
  }
  return compressed;
}

TEST(LinkPace, CompressesOnALinkOfAGigabitAndNotOnLoopback) {
  LinkPace slow, fast;
  EXPECT_FALSE(send(slow, 117e6));  // nothing is known yet
  for (int i = 0; i < 20; ++i) {
    EXPECT_TRUE(send(slow, 117e6));
    EXPECT_FALSE(send(fast, 600e6));
  }
}

TEST(LinkPace, LooksAgainNowAndThen) {
  LinkPace pace;
  int plain = 0;
  for (int i = 0; i < 650; ++i) plain += send(pace, 10e6) ? 0 : 1;
  EXPECT_EQ(plain, 10);
  // The link becomes fast.
  int compressed = 0;
  for (int i = 0; i < 650; ++i) compressed += send(pace, 900e6) ? 1 : 0;
  EXPECT_LE(compressed, 65);
}

TEST(LinkPace, AServerThatTakesAFrameLateIsNoSlowLink) {
  LinkPace pace;
  for (int i = 0; i < 20; ++i) {
    EXPECT_FALSE(pace.next_frame());
    pace.wrote(0, kBand, absl::Seconds(1));
    pace.wrote(1, kBand, absl::Seconds(1));
    for (uint64_t band = 2; band < 7; ++band) {
      pace.wrote(band, kBand, band == 4 ? absl::Seconds(1) : absl::Milliseconds(3));
    }
  }
}

TEST(LinkPace, FramesOfAFewBandsSayNothing) {
  LinkPace pace;
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(send(pace, 1e6, 4));
}

// A session's driver in virtual time and in one thread: faults at every event that a film has, and what it
// waits for. Nothing here waits in real time.

TEST(SessionDriver, ResultsComeOnceAndInOrder) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  const absl::Time begin = clock.now();
  const Outcome got = run(session, 12, 7);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(12, 7));
  EXPECT_EQ(got.stats.resumes, 0u);
  EXPECT_EQ(got.stats.window, 2u);
  EXPECT_EQ(clock.now(), begin);
}

// A call is lost before each event that a film has, then both that call and the one after it.
TEST(SessionDriver, ALossAtAnyEventCostsAndDoublesNoResult) {
  for (const uint32_t lookahead : {0u, 2u}) {
    for (const int again : {0, 5}) {
      bool lost = true;
      for (int cut = 0; lost; ++cut) {
        SCOPED_TRACE(cut);
        VirtualClock clock;
        SessionOptions wanted = options();
        wanted.lookahead = lookahead;
        FakeSession session(2, wanted, clock);
        lost = false;
        const Outcome got = run(session, 9, 4, [&](int event) {
          if ((event != cut && (again == 0 || event != cut + again)) || session.servers.call_now == nullptr)
            return;
          session.servers.call_now->lose(kLost);
          lost |= event == cut;
        });
        ASSERT_OK(got.status);
        ASSERT_EQ(got.values, expected(9, 4));
        ASSERT_EQ(got.stats.answered, 9u);
        const std::vector<FakeServers::Open>& opens = session.servers.opens;
        for (size_t i = 1; i < opens.size(); ++i) {
          EXPECT_NE(opens[i].server, opens[i - 1].server);
          const std::string& token = opens[i].message.resume_token();
          const bool changed = !token.empty() && std::stoi(token) >= 4;
          EXPECT_EQ(opens[i].message.settings().exposure().manual_ev(), changed ? 2 : 1);
        }
      }
    }
  }
}

TEST(SessionDriver, TheLastTokenResumesIt) {
  VirtualClock clock;
  FakeSession session(2, options(), clock);
  session.servers.on_frame = [](size_t server, uint64_t sequence) {
    return server == 0 && sequence == 6 ? kLost : grpc::Status::OK;
  };
  const Outcome got = run(session, 12);
  EXPECT_EQ(got.values, expected(12));
  EXPECT_EQ(got.stats.resumes, 1u);
  EXPECT_GE(got.stats.sent_again, 1u);
  EXPECT_EQ(got.stats.server, "one");
  EXPECT_EQ(got.stats.last_loss, absl::UnavailableError("lost"));
  ASSERT_EQ(session.servers.opens.size(), 2u);
  EXPECT_EQ(session.servers.opens[1].message.resume_token(), "5");
}

TEST(SessionDriver, WithoutATokenYetItOpensAnew) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  int losses = 0;
  session.servers.on_frame = [&](size_t, uint64_t) { return losses++ < 3 ? kLost : grpc::Status::OK; };
  const Outcome got = run(session, 5, 1);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(5, 1));
  EXPECT_EQ(got.stats.resumes, 3u);
  EXPECT_GT(got.stats.time_without_results, absl::ZeroDuration());
  for (const FakeServers::Open& open : session.servers.opens) EXPECT_EQ(open.message.resume_token(), "");
}

TEST(SessionDriver, ItGivesUpWhenItsLimitIsOver) {
  VirtualClock clock;
  FakeSession session(1, options(), clock);
  const absl::Time begin = clock.now();
  session.servers.on_frame = [](size_t, uint64_t sequence) {
    return sequence == 2 ? kLost : grpc::Status::OK;
  };
  const Outcome got = run(session, 9);
  EXPECT_EQ(got.values, expected(2));
  EXPECT_EQ(got.status, absl::UnavailableError("no server has taken the session on for 5s: lost"));
  EXPECT_EQ(clock.now() - begin, absl::Seconds(5));
  EXPECT_EQ(got.stats.time_without_results, absl::Seconds(5));
  EXPECT_GT(session.servers.opens.size(), 4u);
}

TEST(SessionDriver, SilenceIsMeasuredFromTheLastProgress) {
  VirtualClock clock;
  FakeSession session(2, options(), clock);
  session.servers.on_frame = [](size_t server, uint64_t sequence) {
    return server == 0 && sequence == 4 ? FakeServers::kSilent : grpc::Status::OK;
  };
  const Outcome got = run(session, 9);
  EXPECT_EQ(got.values, expected(9));
  ASSERT_EQ(session.servers.opens.size(), 2u);
  EXPECT_EQ(session.servers.opens[1].when - session.servers.opens[0].when, absl::Minutes(1));
  EXPECT_EQ(session.servers.opens[1].message.resume_token(), "3");
  EXPECT_EQ(got.stats.last_loss, absl::UnavailableError("no answer from zero within 1m: it hangs"));
}

TEST(SessionDriver, AServerThatDoesNotOpenItIsLeftAfterTenSeconds) {
  VirtualClock clock;
  FakeSession session(2, options(), clock);
  session.servers.on_open = [](size_t server) {
    return server == 0 ? FakeServers::kSilent : grpc::Status::OK;
  };
  EXPECT_EQ(run(session, 3).values, expected(3));
  EXPECT_EQ(session.servers.opens.at(1).when - session.servers.opens.at(0).when, absl::Seconds(10));
}

TEST(SessionDriver, AServerThatOwesNothingMayBeSilent) {
  VirtualClock clock;
  SessionOptions wanted = options();
  wanted.lookahead = 1;
  FakeSession session(1, wanted, clock);
  session.driver.start();
  session.settle();
  EXPECT_EQ(session.driver.deadline(), absl::InfiniteFuture());
  clock.advance(absl::Hours(1));
  ASSERT_OK(session.state.submit(frame(0)));
  session.driver.on_event(CallEvent::kWoken);
  EXPECT_EQ(session.driver.deadline(), clock.now() + absl::Minutes(1)) << "it has data to read";
  session.settle();
  EXPECT_EQ(session.driver.deadline(), absl::InfiniteFuture()) << "look-ahead holds the frame back";
  session.servers.on_frame = [](size_t, uint64_t) { return FakeServers::kSilent; };
  ASSERT_OK(session.state.submit(frame(1)));
  session.settle();
  EXPECT_EQ(session.driver.deadline(), clock.now() + absl::Minutes(1));
}

// One that has nothing to send is not resumed, and the time does not count. It waits for nothing else.
TEST(SessionDriver, WithoutAFrameItNeedsNoServer) {
  for (const grpc::Status& loss : {kLost, full(60)}) {
    VirtualClock clock;
    FakeSession session(1, options(), clock);
    session.driver.start();
    session.settle();
    session.servers.call_now->lose(loss);
    while (session.step()) continue;
    ASSERT_FALSE(session.driver.ended());
    EXPECT_EQ(session.servers.opens.size(), 1u);
    clock.advance(absl::Hours(1));
    ASSERT_OK(session.state.submit(frame(0)));
    session.state.finish();
    while (session.step()) continue;
    ASSERT_OK_AND_ASSIGN(const std::optional<FrameResult> result, session.state.next_result());
    EXPECT_EQ(result->sequence, 0u);
    EXPECT_EQ(session.state.stats().resumes, 1u);
    EXPECT_EQ(session.state.stats().time_without_results, absl::ZeroDuration());
  }
}

constexpr absl::string_view kCancelled = "the session was cancelled";

TEST(SessionDriver, CancelAtAnyEventEndsIt) {
  bool cancelled = true;
  for (int at = 0; cancelled; ++at) {
    SCOPED_TRACE(at);
    VirtualClock clock;
    FakeSession session(2, options(), clock);
    const absl::Time begin = clock.now();
    session.servers.on_frame = [](size_t server, uint64_t sequence) {
      return server == 0 && sequence == 3 ? full(1) : grpc::Status::OK;
    };
    cancelled = false;
    const Outcome got = run(session, 9, 1000, [&](int event) {
      if (event != at || session.driver.ended()) return;
      cancelled = true;
      session.state.cancel();
    });
    EXPECT_EQ(got.status, cancelled ? absl::CancelledError(kCancelled) : absl::OkStatus());
    EXPECT_LE(got.events, at + 6) << "what was in progress";
    EXPECT_EQ(clock.now(), begin);
  }
}

TEST(SessionDriver, CancelEndsEveryWait) {
  const auto lost_at_once = [](FakeSession& session) {
    session.servers.on_open = [](size_t) { return full(3); };
  };
  const auto lost_later = [](FakeSession& session) {
    session.servers.on_frame = [](size_t, uint64_t) { return full(3); };
  };
  const auto hangs = [](FakeSession& session) {
    session.servers.on_frame = [](size_t, uint64_t) { return FakeServers::kSilent; };
  };
  const auto opens_never = [](FakeSession& session) {
    session.servers.on_open = [](size_t) { return FakeServers::kSilent; };
  };
  const std::vector<std::function<void(FakeSession&)>> cases{lost_at_once, lost_later, hangs, opens_never,
                                                             [](FakeSession&) {}};
  for (size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    VirtualClock clock;
    FakeSession session(1, options(), clock);
    cases[i](session);
    const bool idle = i + 1 == cases.size();
    session.driver.start();
    session.settle();
    if (idle) {
      session.servers.call_now->lose(full(3));
      while (session.step()) continue;
    } else if (session.state.was_open()) {
      ASSERT_OK(session.state.submit(frame(0)));
      session.settle();
    }
    ASSERT_FALSE(session.driver.ended());
    EXPECT_EQ(session.driver.deadline() == absl::InfiniteFuture(), idle);
    session.state.cancel();
    session.settle();
    EXPECT_TRUE(session.driver.ended());
    EXPECT_EQ(session.state.next_result().status(), absl::CancelledError(kCancelled));
  }
}

}  // namespace
}  // namespace candela
