#include "client/session.h"

#include <algorithm>
#include <cstring>
#include <random>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/call/channel.h"
#include "client/call/duplex_call.h"
#include "client/call/shared_memory.h"
#include "client/session_driver.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/clock.h"
#include "server/base/pixel_memory.h"
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
    if (options.transport == Transport::kMemory) {
      RETURN_IF_ERROR(core->memory_.check());
    }
    return Session(std::move(core));
  }

  Core(std::vector<SessionServer> servers, const SessionOptions& options)
      : options_(options),
        name_(options.name.empty() ? random_name() : options.name),
        servers_(std::move(servers)),
        state_(options_, servers_.address(0), clock_, [this] { servers_.wake(); }),
        memory_(options_.transport),
        driver_(servers_, options_, name_, state_, memory_, clock_, std::random_device()()),
        thread_([this] {
          for (driver_.start(); !driver_.ended();) servers_.pass_on(driver_);
        }) {}

  ~Core() {
    state_.cancel();
    thread_.join();
  }

  SessionState& state() { return state_; }

  // Empty if there is none.
  SharedRegion::Area take_area(uint64_t bytes, const v1::ImageSize& frame) {
    const uint32_t window = state_.stats().window;
    return memory_.area(bytes, state_.image_bytes(frame), std::max(window, 1u));
  }

  FrameArea area(const v1::ImageSize& frame, v1::PixelFormat format) {
    const uint64_t bytes = uint64_t{frame.width} * frame.height * bytes_per_pixel(format);
    const SharedRegion::Area shared = take_area(bytes, frame);
    if (shared.bytes != nullptr) return {{shared.bytes.get(), bytes}, shared.bytes};
    const std::shared_ptr<std::byte[]> own(pixels_to_overwrite(bytes));
    return {{own.get(), own == nullptr ? 0 : bytes}, own};
  }

  absl::Status submit(SessionFrame frame) {
    const std::shared_ptr<SharedRegion> region = memory_.region();
    const bool there = region != nullptr && region->offset_of(frame.pixels);
    if (!there && !frame.view && !frame.pixels.empty() && with_alpha(frame.format) == frame.format) {
      const SharedRegion::Area area = take_area(frame.pixels.size(), {frame.width, frame.height});
      if (area.bytes != nullptr) {
        std::memcpy(area.bytes.get(), frame.pixels.data(), frame.pixels.size());
        frame.pixels = {area.bytes.get(), frame.pixels.size()};
        frame.owner = area.bytes;
      }
    }
    return state_.submit(std::move(frame));
  }

  SessionStats stats() const {
    SessionStats stats = state_.stats();
    stats.shares_memory = memory_.region() != nullptr;
    return stats;
  }

  const std::string& name() const { return name_; }

 private:
  RealClock clock_;
  const SessionOptions options_;
  const std::string name_;
  ChannelServers servers_;  // the thread's, but for wake()
  SessionState state_;
  SessionMemory memory_;
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

absl::Status Session::submit(SessionFrame frame) { return core_->submit(std::move(frame)); }
FrameArea Session::area(uint32_t width, uint32_t height, v1::PixelFormat format) {
  return core_->area({width, height}, format);
}
bool Session::ready() const { return core_->state().ready(); }
absl::Status Session::change_settings(uint64_t from_sequence, const v1::Settings& settings) {
  return core_->state().change_settings(from_sequence, settings);
}
void Session::finish() { core_->state().finish(); }
void Session::cancel() { core_->state().cancel(); }
absl::StatusOr<std::optional<FrameResult>> Session::next_result() { return core_->state().next_result(); }
SessionStats Session::stats() const { return core_->stats(); }
const std::string& Session::name() const { return core_->name(); }

}  // namespace candela
