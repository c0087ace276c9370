#include "tests/simulator/intruder.h"

#include "proto/candela/v1/message_wire.h"

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

}  // namespace candela::testing
