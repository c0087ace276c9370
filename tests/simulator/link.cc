#include "tests/simulator/link.h"

#include <algorithm>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/check.h"

namespace candela::testing {
namespace {

constexpr absl::Duration kConnectTimeout = absl::Seconds(20);
constexpr char kReset[] = "Connection reset by peer";

bool tells_to_leave(const grpc::ByteBuffer& message) {
  constexpr size_t kLongest = 100;  // bytes
  v1::StreamResponse response;
  grpc::ByteBuffer copy = message;
  return message.Length() < kLongest && v1::unpack(copy, response) && response.has_go_away();
}

}  // namespace

absl::Duration Network::delay() {
  if (slow_one_in > 0 && world.chance.one_in(slow_one_in)) {
    return world.chance.between(absl::ZeroDuration(), slowest);
  }
  return world.chance.between(absl::Microseconds(50), absl::Milliseconds(2));
}

// The client's end.
class Link::Caller final : public ClientCall {
 public:
  explicit Caller(std::shared_ptr<Link> link) : link_(std::move(link)) {}
  ~Caller() override { CHECK(end().over); }

  bool can_write() const override { return end().told_started && !end().writing && !end().status; }
  bool writing() const override { return end().writing; }
  void write(const grpc::ByteBuffer& message) override { put(message); }
  void half_close() override { put(std::nullopt); }
  grpc::ByteBuffer& message() override { return end().message; }
  void read() override {
    CHECK(!std::exchange(end().reading, true));
    link_->look_at_client();
  }
  void cancel() override {
    link_->cancel_server(link_->network_.delay());
    link_->to_client_.arrived.clear();
    link_->end_client({grpc::CANCELLED, "Cancelled on client"}, absl::ZeroDuration());
  }
  const grpc::Status& status() const override { return *end().status; }
  bool connected() const override { return end().connected || !status().error_details().empty(); }
  absl::Status error() const override {
    return {static_cast<absl::StatusCode>(status().error_code()), status().error_message()};
  }

 private:
  ClientEnd& end() const { return link_->at_client_; }
  void put(Letter letter) {
    CHECK(can_write());
    end().writing = true;
    end().sent = std::move(letter);
    link_->client_sends();
  }
  const std::shared_ptr<Link> link_;
};

Link::Link(Network& network, Process& client, std::function<void(CallEvent)> pass_on)
    : network_(network), world_(network.world), client_(client), pass_on_(std::move(pass_on)) {}

std::unique_ptr<ClientCall> Link::begin(Network& network, Process& client, std::function<Listener()> listener,
                                        std::function<void(CallEvent)> pass_on) {
  auto link = std::make_shared<Link>(network, client, std::move(pass_on));
  network.world.after(network.delay(), [link, listener = std::move(listener)] { link->arrive(listener); });
  return std::make_unique<Caller>(link);
}

void Link::arrive(const std::function<Listener()>& listener) {
  if (at_client_.status) return;  // the client gave up
  Listener found = listener();
  const bool hangs = found.process != nullptr && found.process->stopped();
  if (found.process == nullptr || hangs || network_.cuts()) {
    const absl::Duration learns = hangs || world_.chance.one_in(4) ? kConnectTimeout : network_.delay();
    return end_client({grpc::UNAVAILABLE, "failed to connect to " + found.name}, learns);
  }
  server_ = found.process;
  network_.links.push_back(this);
  at_server_.newest = world_.passed();
  at_client_.started = true;
  look_at_client();
  server_->tell([self = shared_from_this(), accept = std::move(found.accept)] {
    self->call_ = accept(*self);
    self->look_at_server();
  });
}

void Link::send(Way& way, Letter letter) {
  if (cut_) return;
  if (network_.cuts()) {
    const bool lost = &way == &to_client_ || world_.chance.one_in(2);
    world_.note(client_.name(), "loses its connection%s", lost ? ", and a message" : "");
    // One that is not lost comes late: the client may be back before it.
    cut(world_.chance.between(absl::ZeroDuration(), lost ? kConnectTimeout : absl::Seconds(1)),
        world_.chance.between(absl::ZeroDuration(), kConnectTimeout));
    if (lost) return;
  }
  const absl::Duration takes =
      cut_ ? world_.chance.between(absl::ZeroDuration(), network_.slowest) : network_.delay();
  way.newest = std::max(way.newest, world_.passed() + takes);
  world_.after(way.newest - world_.passed(), [self = shared_from_this(), &way, letter = std::move(letter)] {
    // What the client sent before may still come.
    if (self->cut_ && &way == &self->to_client_) return;
    way.arrived.push_back(letter);
    self->look_at_client();
    self->look_at_server();
  });
}

void Link::client_sends() {
  if (!at_client_.sent || to_server_.full()) return;
  ++to_server_.unread;
  send(to_server_, *std::exchange(at_client_.sent, std::nullopt));
  at_client_.written = true;
  at_client_.connected = true;
  look_at_client();
}

void Link::look_at_client() {
  if (at_client_.over || std::exchange(at_client_.looking, true)) return;
  world_.after(world_.chance.between(absl::ZeroDuration(), absl::Microseconds(200)),
               [self = shared_from_this()] {
                 self->client_.tell([self] {
                   self->at_client_.looking = false;
                   const std::optional<CallEvent> event = self->client_event();
                   if (!event) return;
                   if (!self->at_client_.over) self->look_at_client();
                   self->pass_on_(*event);
                 });
               });
}

std::optional<CallEvent> Link::client_event() {
  auto& end = at_client_;
  if (end.started && !std::exchange(end.told_started, true)) return CallEvent::kWritable;
  if (end.writing && (end.written || end.status)) {
    end.writing = end.written = false;
    end.sent.reset();
    return CallEvent::kWritable;
  }
  if (!end.reading || end.over) return std::nullopt;
  if (!to_client_.arrived.empty()) {
    end.message = *std::move(to_client_.arrived.front());
    to_client_.arrived.pop_front();
    --to_client_.unread;
    end.reading = false;
    look_at_server();
    return CallEvent::kMessage;
  }
  if (!end.status) return std::nullopt;
  end.over = true;
  return CallEvent::kEnded;
}

void Link::end_client(const grpc::Status& status, absl::Duration learns) {
  world_.after(learns, [self = shared_from_this(), status] {
    if (self->at_client_.status) return;
    const bool lost = status.error_message() == kReset && !self->at_client_.connected;
    self->at_client_.status =
        lost ? grpc::Status(grpc::UNAVAILABLE, "failed to connect, by a reset") : status;
    self->at_client_.started = true;
    self->look_at_client();
  });
}

void Link::start_read(grpc::ByteBuffer* message) {
  CHECK(std::exchange(at_server_.reading, message) == nullptr);
  look_at_server();
}

void Link::start_write(const grpc::ByteBuffer* message) {
  CHECK(std::exchange(at_server_.writing, message) == nullptr && !at_server_.end);
  look_at_server();
}

void Link::finish(const grpc::Status& status) {
  CHECK(!at_server_.end);
  if (absl::StrContains(status.error_message(), "nothing arrived for")) {
    network_.shortest_idle = std::min(network_.shortest_idle, world_.passed() - at_server_.newest);
  }
  at_server_.end = status;
  look_at_server();
}

void Link::cancel() {
  end_client({grpc::CANCELLED, "the server dropped the call"}, network_.delay());
  cancel_server(absl::ZeroDuration());
}

void Link::cancel_server(absl::Duration learns) {
  world_.after(learns, [self = shared_from_this()] {
    self->at_server_.cancelled = true;
    self->look_at_server();
  });
}

void Link::look_at_server() {
  if (call_ == nullptr || std::exchange(at_server_.looking, true)) return;
  world_.after(world_.chance.between(absl::ZeroDuration(), absl::Microseconds(200)),
               [self = shared_from_this()] {
                 if (self->call_ == nullptr) return;
                 self->server_->tell([self] {
                   self->at_server_.looking = false;
                   if (self->call_ != nullptr && self->server_event()) self->look_at_server();
                 });
               });
}

void Link::something_happens() {
  network_.longest_idle =
      std::max(network_.longest_idle, world_.passed() - std::exchange(at_server_.newest, world_.passed()));
}

bool Link::outstays(absl::Duration time) const {
  constexpr absl::Duration kSoon = absl::Seconds(5);  // the frames that it has get their results
  const ServerEnd& end = at_server_;
  if (!is_open() || cut_ || end.writing != nullptr) return false;
  return time >= absl::Seconds(1) && (!end.leaves || world_.passed() - *end.leaves > kSoon);
}

// One of those that are possible.
bool Link::server_event() {
  auto& end = at_server_;
  const bool over = end.cancelled || end.end;
  std::vector<std::function<void()>> possible;
  if (end.cancelled && !end.told_cancelled) {
    possible.push_back([this] {
      at_server_.told_cancelled = true;
      call_->on_cancel();
    });
  }
  if (end.reading != nullptr && !over && !to_server_.arrived.empty() && to_server_.arrived.front()) {
    possible.push_back([this] {
      std::exchange(at_server_.reading, nullptr)->Swap(&*to_server_.arrived.front());
      to_server_.arrived.pop_front();
      --to_server_.unread;
      client_sends();
      something_happens();
      call_->on_read_done(true);
    });
  } else if (end.reading != nullptr && (over || !to_server_.arrived.empty())) {
    possible.push_back([this] {
      at_server_.reading = nullptr;
      call_->on_read_done(false);
    });
  }
  if (end.writing != nullptr && (end.cancelled || !to_client_.full())) {
    possible.push_back([this] {
      const bool ok = !at_server_.cancelled;
      const grpc::ByteBuffer message = *std::exchange(at_server_.writing, nullptr);
      if (ok) {
        ++to_client_.unread;
        something_happens();
        at_server_.opened = true;
        if (tells_to_leave(message)) at_server_.leaves = world_.passed();
        send(to_client_, message);
      }
      call_->on_write_done(ok);
    });
  }
  if (end.end && end.reading == nullptr && end.writing == nullptr) {
    possible.push_back([this] { end_of_server(); });
  }
  if (possible.empty()) return false;
  possible[world_.chance.below(possible.size())]();
  return true;
}

void Link::end_of_server() {
  something_happens();
  if (!at_server_.cancelled && !cut_) {
    if (network_.cuts()) {
      cut(kConnectTimeout, absl::ZeroDuration());
    } else {
      // Behind the last message.
      const absl::Duration arrives = std::max(to_client_.newest, world_.passed() + network_.delay());
      end_client(*at_server_.end, arrives - world_.passed());
    }
  }
  std::erase(network_.links, this);
  const std::shared_ptr<ServerCall> call = std::exchange(call_, nullptr);
  call->on_done();
  server_.reset();
}

void Link::cut(absl::Duration client_learns, absl::Duration server_learns) {
  if (std::exchange(cut_, true)) return;
  end_client({grpc::UNAVAILABLE, kReset}, client_learns);
  cancel_server(server_learns);
}

void Link::end_by_proxy() {
  if (std::exchange(cut_, true)) return;
  end_client(grpc::Status::OK, network_.delay());
  cancel_server(network_.delay());
}

void Link::end_server() {
  cut(world_.chance.between(absl::ZeroDuration(), absl::Seconds(1)), absl::ZeroDuration());
  std::erase(network_.links, this);
  at_server_.cancelled = true;
  while (call_ != nullptr) CHECK(server_event());
  server_.reset();
}

}  // namespace candela::testing
