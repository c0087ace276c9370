// A client: a session as it is shipped, and the program that submits frames to it and takes the results.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/session_driver.h"
#include "tests/simulator/film.h"
#include "tests/simulator/server.h"

namespace candela::testing {

// What the program does at its own speed.
struct Habits {
  size_t waits_one_in = 4;  // before a frame that it submits
  absl::Duration longest_wait = absl::Milliseconds(50);
  size_t rests_one_in = 4;  // before a result that it takes
  absl::Duration longest_rest = absl::Milliseconds(50);
};

class SimulatedClient final : public Process, private SessionServers {
 public:
  // All outlive it, but for `clock`, its own.
  SimulatedClient(Network& network, std::string name, const WrongClock& clock, const Film& film,
                  const Habits& habits, std::vector<std::unique_ptr<SimulatedServer>>& servers);

  void start();
  void cancel();
  void set_clock(absl::Duration by);
  bool cancelled() const { return cancelled_; }
  // The end of the session, which the program was told.
  const std::optional<absl::Status>& end() const { return end_; }
  // The first result that is wrong, or the first call that failed and should not have.
  const absl::Status& mistake() const { return mistake_; }
  size_t results() const { return results_; }
  bool was_open() const { return state_.was_open(); }
  SessionStats stats() const { return state_.stats(); }
  size_t puts() const { return puts_; }  // panoramas that it gave to servers
  // Since its session had a result, or began.
  absl::Duration waited() const { return world_.passed() - newest_; }
  // The newest token that came, and one that any server with the session open has to refuse; null if there is
  // none.
  struct Token {
    std::string token;
    v1::Settings settings;  // of its frame
  };
  const Token* token() const { return tokens_.empty() ? nullptr : &tokens_.rbegin()->second; }
  const Token* outdated_token() const;
  const Film& film() const { return film_; }

 private:
  size_t count() const override { return servers_.size(); }
  const std::string& address(size_t server) const override { return servers_[server]->name(); }
  std::unique_ptr<ClientCall> call(size_t server, const std::string& session) override;
  void put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time deadline) override;

  void pass_on(CallEvent event);
  void react() override;
  void submit();
  void take();
  void set_timer();
  void look_at(const grpc::ByteBuffer& message);
  void count_answers();

  Network& network_;
  World& world_;
  WrongClock clock_;
  const Film& film_;
  const Habits habits_;
  std::vector<std::unique_ptr<SimulatedServer>>& servers_;
  SessionState state_;
  SessionMemory memory_{Transport::kGrpc};
  SessionDriver driver_;
  std::unique_ptr<Timer> timer_;
  absl::Time timer_at_ = absl::InfiniteFuture();
  size_t submitted_ = 0;
  size_t results_ = 0;
  absl::Duration next_submit_;
  absl::Duration next_take_;
  bool started_ = false;
  bool finished_ = false;
  bool cancelled_ = false;
  ClientCall* call_ = nullptr;        // the last one
  uint64_t epoch_ = 0;                // of that call
  std::map<uint64_t, Token> tokens_;  // the newest of each epoch
  uint64_t answered_ = 0;
  std::optional<uint64_t> answered_epoch_;  // of the call that brought the last result
  absl::Duration newest_;                   // when it came
  std::deque<absl::Duration> calls_;        // since then: when
  size_t puts_ = 0;
  std::optional<absl::Status> end_;
  absl::Status mistake_;
};

}  // namespace candela::testing
