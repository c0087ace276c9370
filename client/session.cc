#include "client/session.h"

#include <algorithm>
#include <map>
#include <random>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/call/retry/retry_schedule.h"
#include "client/call/session_stream.h"
#include "client/call/wire.h"
#include "client/connection.h"
#include "client/session_state.h"
#include "server/base/clock.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

std::string random_name() {
  std::random_device random;
  return absl::StrFormat("session-%08x%08x", random(), random());
}

}  // namespace

// The state and the thread that makes one call after another.
class Session::Core {
 public:
  static absl::StatusOr<Session> open(std::vector<SessionServer> servers, const SessionOptions& options) {
    auto core = std::make_unique<Core>(std::move(servers), options);
    RETURN_IF_ERROR(core->state().wait_until_open());
    return Session(std::move(core));
  }

  Core(std::vector<SessionServer> servers, const SessionOptions& options)
      : options_(options),
        name_(options.name.empty() ? random_name() : options.name),
        servers_(std::move(servers)),
        schedule_(servers_.size(), std::random_device()()),
        state_(options, servers_[0].peer.address, clock_),
        thread_([this] { state_.end(drive()); }) {}

  ~Core() {
    state_.cancel();
    thread_.join();
  }

  SessionState& state() { return state_; }
  const std::string& name() const { return name_; }

 private:
  // Calls one server after another. Returns how the session ends.
  absl::Status drive() {
    while (true) {
      if (!state_.wait_until_needed()) return absl::OkStatus();
      const SessionServer& server = servers_[schedule_.next()];
      CallEnd end = SessionStream(server, options_, name_, state_, clock_).run();
      if (end.progress || !absl::IsNotFound(end.status)) put_on_ = nullptr;
      if (absl::IsNotFound(end.status) && put_on_ != &server && put_panoramas(server, end)) {
        put_on_ = &server;
        continue;
      }
      if (end.status.ok() || !end.resume || state_.cancelled()) return end.status;
      schedule_.failed(clock_.now(), end.retry_delay, end.progress);
      RETURN_IF_ERROR(state_.was_open() ? pause_after(end.status) : pause_before_open(server, end));
    }
  }

  // `server` lacks the environment of a view. Puts the panoramas of all views there that have no result yet.
  // Returns false if the session cannot go on with that; then `end` says why.
  bool put_panoramas(const SessionServer& server, CallEnd& end) {
    const std::map<std::string, std::shared_ptr<const Panorama>> panoramas = state_.panoramas();
    for (const auto& [id, panorama] : panoramas) {
      if (state_.cancelled()) return false;
      const absl::StatusOr<v1::Environment> put =
          Connection(server.channel, server.peer)
              .put_environment(*panorama, clock_.now() + options_.silence_limit);
      if (put.ok() && put->id() == id) continue;
      end.status = put.ok() ? absl::InvalidArgumentError(absl::StrFormat(
                                  "the view's environment is %s, and that of its panorama %s", id, put->id()))
                            : put.status();
      end.resume = absl::IsUnavailable(end.status);
      return false;
    }
    return !panoramas.empty();
  }

  // An open session has lost its server. Waits until the next call may begin.
  absl::Status pause_after(const absl::Status& loss) {
    const absl::Time limit = state_.lose(loss) + options_.resume_limit;
    if (state_.sleep_until(std::min(schedule_.when(), limit)) && clock_.now() < limit) {
      return absl::OkStatus();
    }
    return absl::UnavailableError(absl::StrFormat("no server has taken the session on for %s: %s",
                                                  absl::FormatDuration(options_.resume_limit),
                                                  loss.message()));
  }

  // `server` has not opened the session. Fails if none of them can be reached, or if those that can still
  // refuse it after the limit.
  absl::Status pause_before_open(const SessionServer& server, const CallEnd& end) {
    if (end.reached) {
      if (refusal_.ok()) open_by_ = clock_.now() + options_.resume_limit;
      refusal_ = end.status;
    }
    if (!schedule_.round_over()) return absl::OkStatus();
    if (refusal_.ok()) return end.status;
    if (options_.resume_limit <= absl::ZeroDuration()) return refusal_;
    if (schedule_.when() < open_by_) {
      if (options_.on_open_wait) options_.on_open_wait(server.peer.address, refusal_);
      state_.sleep_until(schedule_.when());
      return absl::OkStatus();
    }
    return absl::UnavailableError(absl::StrFormat("no server opens the session within %s: %s",
                                                  absl::FormatDuration(options_.resume_limit),
                                                  refusal_.message()));
  }

  RealClock clock_;
  const SessionOptions options_;
  const std::string name_;
  const std::vector<SessionServer> servers_;
  RetrySchedule schedule_;  // this and the next three are the thread's
  absl::Status refusal_;    // of the last server that was reached and has not opened the session
  absl::Time open_by_;      // when open() gives up, once a server was reached
  const SessionServer* put_on_ = nullptr;  // got the panoramas, and no call has ended since
  SessionState state_;
  std::thread thread_;  // last, because it uses the others
};

absl::StatusOr<Session> Session::open(const SessionOptions& options) {
  if (options.servers.empty()) {
    return absl::InvalidArgumentError("a session needs the address of at least one server");
  }
  std::vector<SessionServer> servers;
  for (const std::string& address : options.servers) {
    Peer peer{address, options.security};
    ASSIGN_OR_RETURN(std::shared_ptr<grpc::Channel> channel,
                     open_session_channel(peer, options.ping_interval));
    servers.push_back({std::move(channel), std::move(peer)});
  }
  return Core::open(std::move(servers), options);
}

absl::StatusOr<Session> Session::open(std::vector<std::shared_ptr<grpc::Channel>> channels,
                                      const SessionOptions& options) {
  if (channels.empty()) return absl::InvalidArgumentError("a session needs at least one channel");
  std::vector<SessionServer> servers;
  for (std::shared_ptr<grpc::Channel>& channel : channels) {
    servers.push_back({std::move(channel), Peer{"this process"}});
  }
  return Core::open(std::move(servers), options);
}

Session::Session(std::unique_ptr<Core> core) : core_(std::move(core)) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;

absl::Status Session::submit(SessionFrame frame) { return core_->state().submit(std::move(frame)); }
bool Session::ready() const { return core_->state().ready(); }
absl::Status Session::change_settings(uint64_t from_sequence, const v1::Settings& settings) {
  return core_->state().change_settings(from_sequence, settings);
}
void Session::finish() { core_->state().finish(); }
void Session::cancel() { core_->state().cancel(); }
absl::StatusOr<std::optional<FrameResult>> Session::next_result() { return core_->state().next_result(); }
SessionStats Session::stats() const { return core_->state().stats(); }
const std::string& Session::name() const { return core_->name(); }

}  // namespace candela
