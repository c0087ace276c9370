#include "client/session.h"

#include <random>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/call/wire.h"
#include "client/channel_servers.h"
#include "client/session_driver.h"
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

// The state, and the thread that makes the calls.
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
        state_(options_, servers_.address(0), clock_, [this] { servers_.wake(); }),
        driver_(servers_, options_, name_, state_, clock_, std::random_device()()),
        thread_([this] {
          for (driver_.start(); !driver_.ended();) servers_.pass_on(driver_);
        }) {}

  ~Core() {
    state_.cancel();
    thread_.join();
  }

  SessionState& state() { return state_; }
  const std::string& name() const { return name_; }

 private:
  RealClock clock_;
  const SessionOptions options_;
  const std::string name_;
  ChannelServers servers_;  // the thread's, but for wake()
  SessionState state_;
  SessionDriver driver_;  // the thread's
  std::thread thread_;    // last, because it uses the others
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
