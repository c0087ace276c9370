#include "tests/simulator/client.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/message_wire.h"

namespace candela::testing {

SimulatedClient::SimulatedClient(Network& network, std::string name, const WrongClock& clock,
                                 const Film& film, const Habits& habits,
                                 std::vector<std::unique_ptr<SimulatedServer>>& servers)
    : Process(network.world, std::move(name)),
      network_(network),
      world_(network.world),
      clock_(clock),
      film_(film),
      habits_(habits),
      servers_(servers),
      state_(film.options, servers[0]->name(), clock_,
             [this] {
               world_.after(absl::ZeroDuration(), [this] { tell([this] { pass_on(CallEvent::kWoken); }); });
             }),
      driver_(*this, film.options, this->name(), state_, memory_, clock_,
              static_cast<uint32_t>(world_.chance.next())) {}

void SimulatedClient::start() {
  tell([this] {
    started_ = true;
    newest_ = world_.passed();
    driver_.start();
  });
}

void SimulatedClient::cancel() {
  world_.note(name(), "cancels");
  cancelled_ = true;
  tell([this] { state_.cancel(); });
}

std::unique_ptr<ClientCall> SimulatedClient::call(size_t server, const std::string&) {
  world_.note(name(), "calls %s", servers_[server]->name());
  // Five rounds of calls and the pauses between them take longer than that.
  calls_.push_back(world_.passed());
  if (calls_.size() > 8 * count()) {
    if (world_.passed() - calls_.front() < absl::Seconds(1)) {
      mistake_.Update(absl::InternalError("it calls servers without pauses"));
    }
    calls_.pop_front();
  }
  std::unique_ptr<ClientCall> call = Link::begin(
      network_, *this, [target = servers_[server].get()] { return target->listener(); },
      [this](CallEvent event) {
        if (event == CallEvent::kMessage) look_at(call_->message());
        pass_on(event);
      });
  call_ = call.get();
  return call;
}

void SimulatedClient::put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time) {
  ++puts_;
  calls_.clear();
  const auto answer = [this](const absl::StatusOr<v1::Environment>& put) {
    world_.after(network_.delay(), [this, put] { tell([this, put] { driver_.on_put(put); }); });
  };
  world_.after(network_.delay(), [this, target = servers_[server].get(), panorama, answer] {
    if (network_.cuts()) return answer(absl::UnavailableError("Connection reset by peer"));
    answer(target->put(*panorama));
  });
}

void SimulatedClient::pass_on(CallEvent event) {
  if (started_ && !driver_.ended()) driver_.on_event(event);
}

void SimulatedClient::look_at(const grpc::ByteBuffer& message) {
  v1::StreamResponse response;
  grpc::ByteBuffer copy = message;
  if (!v1::unpack(copy, response)) return;
  if (response.has_opened()) {
    epoch_ = response.opened().epoch();
    const uint64_t expected = answered_epoch_ ? *answered_epoch_ + 1 : 0;
    if (epoch_ != expected) {
      mistake_.Update(
          absl::InternalError(absl::StrFormat("a call has epoch %d instead of %d", epoch_, expected)));
    }
  }
  const std::string& token =
      response.has_header() ? response.header().resume_token() : response.failure().resume_token();
  if (!token.empty() && answered_ < film_.settings.size()) {
    tokens_[epoch_] = {token, film_.settings[answered_]};
  }
}

const SimulatedClient::Token* SimulatedClient::outdated_token() const {
  if (tokens_.empty() || answered_epoch_.value_or(0) < tokens_.begin()->first + 2) return nullptr;
  return &tokens_.begin()->second;
}

void SimulatedClient::count_answers() {
  if (const uint64_t answered = state_.stats().answered; answered != answered_) {
    answered_ = answered;
    answered_epoch_ = epoch_;
    newest_ = world_.passed();
    calls_.clear();
  }
}

void SimulatedClient::react() {
  count_answers();
  take();
  submit();
  set_timer();
}

void SimulatedClient::set_clock(absl::Duration by) {
  world_.note(name(), "has its clock set by %s", absl::FormatDuration(by));
  clock_.set(by);
  timer_at_ = absl::InfinitePast();
  tell([] {});
}

void SimulatedClient::submit() {
  while (!finished_ && state_.ready() && world_.passed() >= next_submit_) {
    if (submitted_ == film_.frames.size()) {
      finished_ = true;
      state_.finish();
      return;
    }
    absl::Status status;
    if (const auto change = film_.changes.find(submitted_); change != film_.changes.end()) {
      status = state_.change_settings(change->second.from_sequence(), change->second.settings());
    }
    if (status.ok()) status = state_.submit(film_.frames[submitted_++]);
    if (!status.ok()) {  // the session has ended, which take() will be told, too
      if (absl::IsInvalidArgument(status)) mistake_.Update(status);
      finished_ = true;
      return;
    }
    if (!world_.chance.one_in(habits_.waits_one_in)) continue;
    const absl::Duration wait = world_.chance.between(absl::ZeroDuration(), habits_.longest_wait);
    next_submit_ = world_.passed() + wait;
    world_.after(wait, [this] { tell([] {}); });
  }
}

void SimulatedClient::take() {
  while (!end_ && state_.result_ready() && world_.passed() >= next_take_) {
    const absl::StatusOr<std::optional<FrameResult>> result = state_.next_result();
    if (!result.ok() || !*result) {
      world_.note(name(), "ends with %s", result.status().ToString());
      end_ = result.status();
      return;
    }
    world_.note(name(), "has the result of frame %d: %s", (*result)->sequence, (*result)->status.ToString());
    mistake_.Update(check_result(film_, results_++, **result));
    if (!world_.chance.one_in(habits_.rests_one_in)) continue;
    const absl::Duration rest = world_.chance.between(absl::ZeroDuration(), habits_.longest_rest);
    next_take_ = world_.passed() + rest;
    world_.after(rest, [this] { tell([] {}); });
  }
}

void SimulatedClient::set_timer() {
  const absl::Time deadline = driver_.deadline();
  if (deadline == timer_at_) return;
  timer_at_ = deadline;
  timer_.reset();
  if (deadline == absl::InfiniteFuture()) return;
  timer_ = world_.call_after(deadline - clock_.now(), [this] {
    timer_at_ = absl::InfiniteFuture();
    tell([this] {
      if (driver_.deadline() <= clock_.now()) pass_on(CallEvent::kTimeout);
    });
  });
}

}  // namespace candela::testing
