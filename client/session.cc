#include "client/session.h"

#include <algorithm>
#include <random>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/call/session_stream.h"
#include "client/call/wire.h"
#include "client/session_state.h"

namespace candela {
namespace {

// The pause between rounds over all servers. It doubles from round to round.
constexpr absl::Duration kFirstPause = absl::Milliseconds(50);
constexpr absl::Duration kLongestPause = absl::Seconds(1);

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
    if (absl::Status status = core->state().wait_until_open(); !status.ok()) return status;
    return Session(std::move(core));
  }

  Core(std::vector<SessionServer> servers, const SessionOptions& options)
      : options_(options),
        name_(options.name.empty() ? random_name() : options.name),
        servers_(std::move(servers)),
        not_before_(servers_.size(), absl::InfinitePast()),
        state_(options, servers_[0].peer.address),
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
    size_t attempts = 0;  // calls since the last result
    for (size_t at = 0;; at = (at + 1) % servers_.size()) {
      const CallEnd end = SessionStream(servers_[at], options_, name_, state_).run();
      if (end.status.ok() || !end.resume || state_.cancelled()) return end.status;
      attempts = end.progress ? 1 : attempts + 1;
      not_before_[at] = absl::Now() + end.retry_delay;
      if (!state_.was_open()) {
        if (attempts == servers_.size()) return end.status;
        continue;
      }
      const absl::Time limit = state_.lose(end.status) + options_.resume_limit;
      if (!pause_before_attempt(attempts, (at + 1) % servers_.size(), limit)) {
        return absl::UnavailableError(absl::StrFormat("no server has taken the session on for %s: %s",
                                                      absl::FormatDuration(options_.resume_limit),
                                                      end.status.message()));
      }
    }
  }

  // Waits until the server `next` may be called. False if the session is cancelled or `limit` comes first.
  bool pause_before_attempt(size_t attempts, size_t next, absl::Time limit) const {
    absl::Time until = absl::Now();
    // The first round over all servers has no pauses. With a single server only its first try has none.
    if (attempts > 1 && attempts % servers_.size() == 0) {
      const size_t rounds = std::min<size_t>(attempts / servers_.size() - 1, 10);
      until += std::min(kLongestPause, kFirstPause * (int64_t{1} << rounds));
    }
    until = std::max(until, not_before_[next]);
    return state_.sleep_until(std::min(until, limit)) && absl::Now() < limit;
  }

  const SessionOptions options_;
  const std::string name_;
  const std::vector<SessionServer> servers_;
  std::vector<absl::Time> not_before_;  // when each server wants to be called again; the thread's
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
    absl::StatusOr<std::shared_ptr<grpc::Channel>> channel =
        open_session_channel(peer, options.ping_interval);
    if (!channel.ok()) return channel.status();
    servers.push_back({*std::move(channel), std::move(peer)});
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
