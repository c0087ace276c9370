// Servers of a session in virtual time and in one thread: calls without gRPC's connections, whose events a
// test passes on one by one.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/session_driver.h"
#include "tests/support/clock/virtual_clock.h"

namespace candela {

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

}  // namespace candela
