#include "tests/simulator/history.h"

#include <algorithm>
#include <array>
#include <memory>
#include <utility>

#include "absl/strings/str_format.h"
#include "tests/simulator/client.h"
#include "tests/simulator/judge.h"
#include "tests/simulator/server.h"

namespace candela::testing {
namespace {

constexpr uint64_t kMostEvents = 2'000'000;

class History {
 public:
  History(uint64_t seed, bool log);
  ~History() { world_.end(); }
  HistoryReport run();

  struct Fault {
    const char* name;
    const char* what;
    void (History::*set_up)();  // before the servers start; null: nothing
    void (History::*strike)();  // now; null: nothing
  };
  static const std::vector<Fault>& faults();

 private:
  Chance& chance() { return world_.chance; }
  absl::Duration up_to(absl::Duration longest) { return chance().between(absl::ZeroDuration(), longest); }
  SimulatedServer& some_server() { return *servers_[chance().below(servers_.size())]; }
  SimulatedClient& some_client() { return *clients_[chance().below(clients_.size())]; }
  Link* some_link();
  bool has(const char* fault) const { return struck_.contains(fault); }
  void fail(const std::string& who, const absl::Status& why);

  void plan();
  void schedule_strikes();
  void stop_faults();
  bool settled() const;

  void slow_network();
  void cutting_network();
  void few_places();
  void little_memory();
  void wrong_clocks();
  void short_tokens();
  void slow_readers();
  void slow_senders();
  void cut_link();
  void end_by_proxy();
  void kill_server();
  void stop_server();
  void drain_server();
  void lose_device();
  void hang_device();
  void stop_client();
  void cancel_client();
  void set_clocks();
  void take_session();
  void take_session_late();
  void use_name();
  void restart_all();
  void intrude(const SimulatedClient& client, const v1::Settings& settings, const std::string& token);

  World world_;
  Network network_{world_};
  ServerPlan server_plan_;
  FilmPlan film_plan_;
  Habits habits_;
  bool short_lived_ = false;  // tokens
  bool impatient_ = false;    // the sessions give up soon
  bool clocks_are_wrong_ = false;
  size_t sound_ = 0;  // the server whose device never hangs for ever
  absl::Duration faults_last_;
  std::vector<const Fault*> chosen_;
  std::map<std::string, uint64_t> struck_;
  std::vector<std::unique_ptr<SimulatedServer>> servers_;
  std::vector<Film> films_;
  std::vector<std::unique_ptr<SimulatedClient>> clients_;
  std::vector<std::unique_ptr<Intruder>> intruders_;
  absl::Status verdict_;
  uint64_t events_ = 0;
};

const std::vector<History::Fault>& History::faults() {
  static const std::vector<Fault> all = {
      {"delay", "messages take up to 3 s", &History::slow_network, nullptr},
      {"lost_message", "a connection is cut at a message, which may be lost", &History::cutting_network,
       nullptr},
      {"cut", "a connection is cut, and each end learns of it within 20 s", nullptr, &History::cut_link},
      {"proxy_end", "a proxy ends a call with OK", nullptr, &History::end_by_proxy},
      {"kill", "a server is killed, and starts again within 10 s", nullptr, &History::kill_server},
      {"restart_all", "all servers are killed and start again", nullptr, &History::restart_all},
      {"stop_server", "a server is stopped for up to 40 s", nullptr, &History::stop_server},
      {"drain", "a server drains, ends and starts again", nullptr, &History::drain_server},
      {"full", "servers take one session at a time", &History::few_places, nullptr},
      {"little_memory", "servers have memory for few frames", &History::little_memory, nullptr},
      {"lost_device", "a device is lost, with its panoramas", nullptr, &History::lose_device},
      {"hanging_device", "a device hangs for up to 40 s, or for ever if there is another server", nullptr,
       &History::hang_device},
      {"stop_client", "a client is stopped for up to 40 s", nullptr, &History::stop_client},
      {"cancel", "a client cancels", nullptr, &History::cancel_client},
      {"slow_reader", "clients take results late", &History::slow_readers, nullptr},
      {"slow_sender", "clients pause longer than the idle timeout", &History::slow_senders, nullptr},
      {"wrong_clock", "clocks are wrong and drift apart", &History::wrong_clocks, nullptr},
      {"set_clock", "a clock is set by up to 30 s", nullptr, &History::set_clocks},
      {"expired_token", "tokens are valid for 15 s", &History::short_tokens, nullptr},
      {"duplicate_resume", "another call resumes the session with its token", nullptr,
       &History::take_session},
      {"outdated_resume", "another call resumes the session with a token from before its last resume",
       nullptr, &History::take_session_late},
      {"duplicate_name", "another call opens the session's name", nullptr, &History::use_name},
  };
  return all;
}

// The same in every history of a process.
const TokenKeys& token_keys(bool short_lived) {
  static const TokenKeys usual = TokenKeys::random().value();
  static const TokenKeys brief = TokenKeys::random(absl::Seconds(15)).value();
  return short_lived ? brief : usual;
}

History::History(uint64_t seed, bool log) : world_(seed, log) { plan(); }

void History::plan() {
  server_plan_.idle_timeout =
      std::array{absl::Seconds(5), absl::Seconds(10), absl::Seconds(60)}[chance().below(3)];
  server_plan_.max_frames_in_flight = static_cast<uint32_t>(1 + chance().below(4));
  if (!chance().one_in(16)) {
    const size_t rarity = 2 + chance().below(6);
    for (const Fault& fault : faults()) {
      if (!chance().one_in(rarity)) continue;
      chosen_.push_back(&fault);
      if (fault.set_up == nullptr) continue;
      (this->*fault.set_up)();
      ++struck_[fault.name];
    }
  }
  film_plan_.views = chance().one_in(4);
  impatient_ = chance().one_in(10);
  if (chance().one_in(4)) habits_.longest_wait = absl::Seconds(3);
  faults_last_ = up_to(chance().one_in(2) ? absl::Seconds(1) : absl::Seconds(60));
  const size_t servers = 1 + chance().below(3);
  for (size_t i = 0; i < servers; ++i) {
    ServerPlan plan = server_plan_;
    if (clocks_are_wrong_) {
      plan.clock_offset = up_to(absl::Seconds(10)) - up_to(absl::Seconds(10));
      plan.clock_drift = (static_cast<double>(chance().below(200)) - 100) * 1e-5;
    }
    servers_.push_back(std::make_unique<SimulatedServer>(network_, absl::StrFormat("server-%d", i), plan,
                                                         token_keys(short_lived_)));
    servers_.back()->start();
  }
  sound_ = chance().below(servers);
  const size_t clients = 1 + chance().below(3);
  for (size_t i = 0; i < clients; ++i) {
    films_.push_back(make_film(chance(), film_plan_));
    SessionOptions& options = films_.back().options;
    options.resume_limit = impatient_ ? absl::Seconds(5) : absl::Hours(1);
    options.silence_limit = absl::Seconds(60);
  }
  for (size_t i = 0; i < clients; ++i) {
    const double drift = clocks_are_wrong_ ? (static_cast<double>(chance().below(200)) - 100) * 1e-5 : 0;
    clients_.push_back(std::make_unique<SimulatedClient>(network_, absl::StrFormat("client-%d", i),
                                                         WrongClock(world_, absl::ZeroDuration(), drift),
                                                         films_[i], habits_, servers_));
  }
}

HistoryReport History::run() {
  for (const auto& client : clients_) {
    world_.after(up_to(faults_last_ / 4), [&client] { client->start(); });
  }
  schedule_strikes();
  // The bound: what the clients themselves wait, and a few of the longest limits one after another.
  absl::Duration bound = faults_last_ + (chosen_.empty() ? absl::Seconds(10) : absl::Minutes(10));
  for (const Film& film : films_) {
    bound += static_cast<double>(film.frames.size()) * (habits_.longest_wait + habits_.longest_rest);
    // Each frame may meet two devices that hang for ever.
    if (has("hanging_device")) bound += static_cast<double>(film.frames.size()) * absl::Minutes(3);
  }
  while (!settled() && verdict_.ok() && world_.step()) {
    if (++events_ > kMostEvents) fail("history", absl::InternalError("it takes too many events"));
    if (world_.passed() > bound) {
      for (const auto& client : clients_) {
        if (!client->end()) fail(client->name(), absl::InternalError("it has waited beyond the bound"));
      }
      if (verdict_.ok()) fail("network", absl::InternalError("a server keeps a call beyond the bound"));
    }
  }
  if (verdict_.ok() && !settled()) {
    for (const auto& client : clients_) {
      if (!client->end()) fail(client->name(), absl::InternalError("nothing will ever happen to it"));
    }
    if (verdict_.ok()) fail("network", absl::InternalError("a server keeps a call for ever"));
  }
  HistoryReport report;
  for (const auto& client : clients_) {
    fail(client->name(), judge(*client, {struck_, !chosen_.empty(), impatient_}));
    report.frames += client->results();
    report.resumes += client->stats().resumes;
    if (client->end()) ++report.ends[absl::StatusCodeToString(client->end()->code())];
  }
  if (network_.shortest_idle < 0.99 * server_plan_.idle_timeout && !has("set_clock")) {
    fail("network", absl::InternalError("a server ends a call as idle that is not"));
  }
  if (network_.longest_idle > 2 * server_plan_.idle_timeout + absl::Seconds(5) && !has("hanging_device") &&
      !has("stop_server") && !has("set_clock")) {
    fail("network",
         absl::InternalError(absl::StrFormat(
             "a server with an idle timeout of %s keeps a call for %s in which nothing happens",
             absl::FormatDuration(server_plan_.idle_timeout), absl::FormatDuration(network_.longest_idle))));
  }
  for (const auto& server : servers_) {
    fail(server->name(), server->left_behind());
    if (verdict_.ok()) fail(server->name(), server->kill());
  }
  report.verdict = verdict_;
  report.lasted = world_.passed();
  report.events = events_;
  report.struck = struck_;
  return report;
}

void History::fail(const std::string& who, const absl::Status& why) {
  if (why.ok() || !verdict_.ok()) return;
  world_.note(who, "WRONG: %s", why.ToString());
  verdict_ = absl::InternalError(who + ": " + std::string(why.message()));
}

void History::schedule_strikes() {
  std::vector<const Fault*> striking;
  for (const Fault* fault : chosen_) {
    if (fault->strike != nullptr) striking.push_back(fault);
  }
  const size_t strikes = striking.empty() ? 0 : 1 + chance().below(8);
  for (size_t i = 0; i < strikes; ++i) {
    const Fault* fault = striking[chance().below(striking.size())];
    world_.after(up_to(faults_last_), [this, fault] {
      ++struck_[fault->name];
      (this->*fault->strike)();
    });
  }
  world_.after(faults_last_, [this] { stop_faults(); });
}

void History::stop_faults() {
  world_.note("history", "has no more faults");
  network_.slow_one_in = network_.cut_one_in = 0;
  for (const auto& server : servers_) {
    server->start();
    server->go_on();
  }
  for (const auto& client : clients_) client->go_on();
}

bool History::settled() const {
  return world_.passed() >= faults_last_ && network_.links.empty() &&
         std::all_of(clients_.begin(), clients_.end(),
                     [](const auto& client) { return client->end().has_value(); }) &&
         std::all_of(intruders_.begin(), intruders_.end(),
                     [](const auto& intruder) { return intruder->ended(); });
}

Link* History::some_link() {
  return network_.links.empty() ? nullptr : network_.links[chance().below(network_.links.size())];
}

void History::slow_network() { network_.slow_one_in = 2 + chance().below(20); }
void History::cutting_network() { network_.cut_one_in = 5 + chance().below(100); }
void History::few_places() { server_plan_.max_sessions = 1; }
void History::little_memory() {
  server_plan_.memory_bytes = 1 << 14;
  film_plan_.large_frames = false;
}
void History::wrong_clocks() { clocks_are_wrong_ = true; }
void History::short_tokens() { short_lived_ = true; }
void History::slow_readers() {
  habits_.rests_one_in = 3;
  habits_.longest_rest = absl::Seconds(20);
}
void History::slow_senders() {
  habits_.waits_one_in = 3;
  habits_.longest_wait = absl::Seconds(70);
}

void History::cut_link() {
  if (Link* link = some_link()) link->cut(up_to(absl::Seconds(20)), up_to(absl::Seconds(20)));
}

void History::end_by_proxy() {
  if (Link* link = some_link()) link->end_by_proxy();
}

void History::kill_server() {
  SimulatedServer& server = some_server();
  fail(server.name(), server.kill());
  world_.after(up_to(absl::Seconds(10)), [&server] { server.start(); });
}

void History::restart_all() {
  for (const auto& server : servers_) {
    fail(server->name(), server->kill());
    world_.after(up_to(absl::Seconds(1)), [&server] { server->start(); });
  }
}

void History::stop_server() {
  SimulatedServer& server = some_server();
  server.stop();
  world_.after(up_to(absl::Seconds(40)), [&server] { server.go_on(); });
}

void History::drain_server() { some_server().drain(up_to(absl::Seconds(20))); }

void History::lose_device() { some_server().lose_device(up_to(absl::Seconds(2))); }
void History::hang_device() {
  SimulatedServer& server = some_server();
  const bool for_ever = &server != servers_[sound_].get() && chance().one_in(3);
  server.hang_device(for_ever ? absl::InfiniteDuration() : up_to(absl::Seconds(40)));
}

void History::stop_client() {
  SimulatedClient& client = some_client();
  client.stop();
  world_.after(up_to(absl::Seconds(40)), [&client] { client.go_on(); });
}

void History::cancel_client() { some_client().cancel(); }

void History::set_clocks() {
  const absl::Duration by = up_to(absl::Seconds(30)) - up_to(absl::Seconds(30));
  if (chance().one_in(2)) {
    some_server().set_clock(by);
  } else {
    some_client().set_clock(by);
  }
}

void History::intrude(const SimulatedClient& client, const v1::Settings& settings, const std::string& token) {
  intruders_.push_back(std::make_unique<Intruder>(network_, some_server(), client.name(), settings, token,
                                                  up_to(absl::Seconds(5))));
}

void History::take_session() {
  SimulatedClient& client = some_client();
  if (const SimulatedClient::Token* token = client.token()) intrude(client, token->settings, token->token);
}

void History::take_session_late() {
  SimulatedClient& client = some_client();
  if (const SimulatedClient::Token* token = client.outdated_token())
    intrude(client, token->settings, token->token);
}

void History::use_name() { intrude(some_client(), v1::Settings(), ""); }

}  // namespace

HistoryReport run_history(uint64_t seed, bool log) {
  auto history = std::make_unique<History>(seed, log);
  HistoryReport report = history->run();
  if (!report.verdict.ok()) history.release();  // what it leaves cannot be destroyed in order
  return report;
}

std::vector<std::pair<std::string, std::string>> all_faults() {
  std::vector<std::pair<std::string, std::string>> all;
  for (const History::Fault& fault : History::faults()) all.emplace_back(fault.name, fault.what);
  return all;
}

}  // namespace candela::testing
