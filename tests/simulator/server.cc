#include "tests/simulator/server.h"

#include <algorithm>
#include <deque>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/message_wire.h"
#include "server/rpc/stream_call.h"
#include "server/session/sessions.h"
#include "tests/simulator/film.h"
#include "tests/support/simulated/frame_maker.h"

namespace candela::testing {

Intruder::Intruder(Network& network, SimulatedServer& server, const std::string& session,
                   const v1::Settings& settings, const std::string& token, absl::Duration stay)
    : Process(network.world, "intruder") {
  world().note(name(), "opens %s %s a token", session, token.empty() ? "without" : "with");
  v1::StreamOpen& open = *open_.mutable_open();
  open.set_session(session);
  *open.mutable_settings() = settings;
  open.set_resume_token(token);
  call_ = Link::begin(
      network, *this, [&server] { return server.listener(); }, [this](CallEvent event) { on_event(event); });
  world().after(stay, [this] {
    if (call_ != nullptr) call_->cancel();
  });
}

void Intruder::on_event(CallEvent event) {
  if (event == CallEvent::kMessage) call_->read();
  if (event == CallEvent::kEnded) {
    world().note(name(), "ends with %s", call_->error().ToString());
    return call_.reset();
  }
  if (call_->can_write() && !std::exchange(asked_, true)) call_->write(v1::pack(open_));
}

namespace {

constexpr size_t kQueue = 64;  // jobs

}  // namespace

// Timers that ring in a process.
class SimulatedServer::ProcessTimers final : public Timers {
 public:
  explicit ProcessTimers(Process& process) : process_(process) {}
  std::unique_ptr<Timer> call_after(absl::Duration wait, std::function<void()> then) override {
    auto set = std::make_shared<bool>(true);
    return std::make_unique<Ring>(set, process_.world().call_after(wait, [this, set, then = std::move(then)] {
      process_.tell([set, then] {
        if (*set) then();
      });
    }));
  }

 private:
  struct Ring final : Timer {
    Ring(std::shared_ptr<bool> is_set, std::unique_ptr<Timer> alarm)
        : set(std::move(is_set)), timer(std::move(alarm)) {}
    ~Ring() override { *set = false; }
    const std::shared_ptr<bool> set;
    const std::unique_ptr<Timer> timer;
  };
  Process& process_;
};

// One process.
class SimulatedServer::Life final : public Process,
                                    public WorkerPool,
                                    public std::enable_shared_from_this<Life> {
 public:
  Life(Network& network, const std::string& name, const ServerPlan& plan, const TokenKeys& keys)
      : Process(network.world, name),
        network_(network),
        clock_(network.world, plan.clock_offset, plan.clock_drift),
        timers_(*this),
        memory_bytes_(plan.memory_bytes),
        places_(plan.max_sessions),
        maker_(std::make_shared<SimulatedFrameMaker>(memory_bytes_, clock_)),
        steps_(run_job, kQueue, clock_),
        state_{.clock = clock_,
               .timers = timers_,
               .rendering = {.renderer = [this]() -> std::shared_ptr<FrameMaker> { return maker_; },
                             .loop = steps_,
                             .encoders = *this,
                             .device = "simulated",
                             .bits = "simulated"},
               .limits = {{.max_dimension = 1024, .max_frame_bytes = 1 << 20},
                          plan.idle_timeout,
                          plan.max_frames_in_flight},
               .metrics = metrics_,
               .call_gate = CallGate("calls", 4),
               .session_gate = CallGate("sessions", plan.max_sessions),
               .sessions = {.keys = keys,
                            .memory =
                                std::make_shared<ClientMemory>(plan.memory_bytes, 50, plan.idle_timeout / 2)},
               .environments = EnvironmentStore(plan.environment_bytes)} {}

  // The event, unless the process has ended by then.
  std::function<void()> told(std::function<void()> then) {
    return [life = weak_from_this(), then = std::move(then)] {
      if (const std::shared_ptr<Life> alive = life.lock()) alive->tell(then);
    };
  }

  ServiceState& state() { return state_; }
  WrongClock& clock() { return clock_; }

  void run(std::function<void()> task) override {
    tasks_.push_back(std::move(task));
    later(absl::Microseconds(10), absl::Milliseconds(5), [this] { encode(); });
  }

  // The render loop stands still.
  void hang_device(absl::Duration time) { hangs_until_ = world().passed() + time; }
  bool hung() const { return hangs_until_ > absl::ZeroDuration(); }  // at any time
  void lose_device() { maker_->lose(); }
  void new_device() {
    maker_ = std::make_shared<SimulatedFrameMaker>(memory_bytes_, clock_);
    state_.environments.forget_others(*maker_);
  }

  void drain(std::function<void(bool)> ended) {
    drain_ = Drain::begin(state_.call_gate, state_.session_gate, state_.sessions.table, std::move(ended));
  }
  void end_drain() { drain_->on_time(); }
  bool drains() const { return drain_ != nullptr; }

  // After the last call has ended.
  absl::Status holds_nothing() {
    while (steps_.step() || encode()) {
    }
    if (too_many_) return absl::InternalError("a gate let more in than it has places");
    if (unlisted_) return absl::InternalError("the table lacked a session that was open");
    const auto held = [](bool any, const std::string& what) {
      return any ? absl::InternalError("an ended process still holds " + what) : absl::OkStatus();
    };
    bool empty = false;
    state_.session_gate.close();
    state_.session_gate.when_empty([&empty] { empty = true; });
    for (const absl::Status& status :
         {held(!empty, "a call in its gate"),
          held(state_.session_gate.places_taken() > 0, "a place in its gate"),
          held(!state_.sessions.table.all().empty(), "a session"),
          held(state_.sessions.memory->frames_bytes() > 0, "a claim for a frame"),
          held(!nothing_promised(), "a promise for look-ahead"),
          held(maker_->counters().bytes_in_use > 0, "a texture")}) {
      if (!status.ok()) return status;
    }
    return absl::OkStatus();
  }

 private:
  // All of it can be promised.
  bool nothing_promised() {
    ClientMemory& memory = *state_.sessions.memory;
    return memory.promise_lookahead(0, 0, memory.budget_bytes()).ok();
  }

  void react() override {
    too_many_ |= state_.session_gate.places_taken() > places_;
    const auto open = std::count_if(network_.links.begin(), network_.links.end(), [this](const Link* link) {
      return link->server() == this && link->is_open();
    });
    unlisted_ |= state_.sessions.table.all().size() < static_cast<size_t>(open);
    if (step_due_ || steps_.waiting() == 0) return;
    step_due_ = true;
    later(absl::Microseconds(100), absl::Milliseconds(20), [this] { step(); });
  }

  void step() {
    if (hangs_until_ == absl::InfiniteDuration()) return;
    if (world().passed() < hangs_until_)
      return world().after(hangs_until_ - world().passed(), told([this] { step(); }));
    step_due_ = false;
    steps_.step();
  }

  bool encode() {
    if (tasks_.empty()) return false;
    const std::function<void()> task = std::move(tasks_.front());
    tasks_.pop_front();
    task();
    return true;
  }

  void later(absl::Duration least, absl::Duration most, std::function<void()> then) {
    world().after(world().chance.between(least, most), told(std::move(then)));
  }
  Network& network_;
  WrongClock clock_;
  ProcessTimers timers_;
  const uint64_t memory_bytes_;
  const uint32_t places_;
  bool too_many_ = false;
  bool unlisted_ = false;
  std::shared_ptr<SimulatedFrameMaker> maker_;
  Metrics metrics_{"version", "simulated", "driver", "passes"};
  RenderSteps steps_;
  ServiceState state_;
  std::deque<std::function<void()>> tasks_;  // of the encoders
  std::shared_ptr<Drain> drain_;
  bool step_due_ = false;
  absl::Duration hangs_until_ = absl::ZeroDuration();
};

SimulatedServer::SimulatedServer(Network& network, std::string name, const ServerPlan& plan,
                                 const TokenKeys& keys)
    : network_(network), world_(network.world), name_(std::move(name)), plan_(plan), keys_(keys) {}

SimulatedServer::~SimulatedServer() = default;

void SimulatedServer::start() {
  if (life_ != nullptr) return;
  world_.note(name_, "starts");
  life_ = std::make_shared<Life>(network_, name_, plan_, keys_);
}

absl::Status SimulatedServer::kill() {
  if (life_ == nullptr) return absl::OkStatus();
  world_.note(name_, "ends");
  const std::shared_ptr<Life> life = std::exchange(life_, nullptr);
  const std::vector<Link*> links = network_.links;
  for (Link* link : links) {
    if (link->server() == life.get()) link->shared_from_this()->end_server();
  }
  return life->holds_nothing();
}

void SimulatedServer::stop() {
  if (life_ != nullptr) life_->stop();
}

void SimulatedServer::go_on() {
  if (life_ != nullptr) life_->go_on();
}

void SimulatedServer::drain(absl::Duration timeout) {
  if (life_ == nullptr || life_->drains() || life_->stopped()) return;
  world_.note(name_, "drains");
  const auto end = [this, life = std::weak_ptr<Life>(life_)] {
    if (life.lock() != life_ || life_ == nullptr) return;
    left_behind_.Update(kill());
    world_.after(world_.chance.between(absl::ZeroDuration(), absl::Seconds(5)), [this] { start(); });
  };
  // Not from inside the drain, which the last call to leave may end.
  life_->told([this, end, life = life_.get()] {
    life->drain([this, end](bool) { world_.after(absl::ZeroDuration(), end); });
  })();
  world_.after(timeout, life_->told([this, timeout, life = life_.get()] {
    left_behind_.Update(check_drain(timeout));
    life->end_drain();
  }));
}

// At the end of the time that it may take.
absl::Status SimulatedServer::check_drain(absl::Duration time) const {
  if (life_ == nullptr || life_->hung()) return absl::OkStatus();
  bool any = false;
  for (const Link* link : network_.links) {
    if (link->server() != life_.get()) continue;
    any = true;
    if (link->outstays(time)) return absl::InternalError("a session does not leave a server that drains");
  }
  return any ? absl::OkStatus() : absl::InternalError("a drain that has no call left does not end");
}

void SimulatedServer::lose_device(absl::Duration until_next) {
  if (life_ == nullptr) return;
  world_.note(name_, "loses its device");
  life_->lose_device();
  world_.after(until_next, life_->told([life = life_.get()] { life->new_device(); }));
}

void SimulatedServer::hang_device(absl::Duration time) {
  if (life_ == nullptr) return;
  world_.note(name_, "has a device that hangs for %s", absl::FormatDuration(time));
  life_->hang_device(time);
}

void SimulatedServer::set_clock(absl::Duration by) {
  if (life_ == nullptr) return;
  world_.note(name_, "has its clock set by %s", absl::FormatDuration(by));
  life_->clock().set(by);
}

Listener SimulatedServer::listener() {
  Listener listener{.name = name_};
  if (life_ == nullptr) return listener;
  listener.process = life_;
  listener.accept = [life = life_](CallTransport& transport) {
    return StreamCall::begin(transport, life->state());
  };
  return listener;
}

absl::StatusOr<v1::Environment> SimulatedServer::put(const Panorama& panorama) {
  if (life_ == nullptr || life_->stopped()) return absl::UnavailableError("failed to connect to " + name_);
  EnvironmentStore& store = life_->state().environments;
  const uint64_t bytes = environment_bytes(panorama.start.width(), panorama.pixels.size());
  absl::StatusOr<EnvironmentRoom> room = store.make_room(bytes);
  if (!room.ok()) return room.status();
  auto kept = std::make_shared<KeptEnvironment>();
  kept->facts.set_id(environment_id(panorama));
  kept->room = *std::move(room);
  kept->renderer = life_->state().rendering.renderer();
  identify(kept->environment, panorama);
  world_.note(name_, "is given a panorama");
  return store.keep(std::move(kept))->facts;
}

}  // namespace candela::testing
