// One Stream call between a client and a server, in place of gRPC: what each end is told, and what travels.
#pragma once

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/call/client_call.h"
#include "server/rpc/server_call.h"
#include "tests/simulator/world.h"

namespace candela::testing {

class Link;

// What all links share.
struct Network {
  World& world;
  size_t slow_one_in = 0;  // messages; 0: none
  size_t cut_one_in = 0;   // messages that are the last of their connection, and lost
  absl::Duration slowest = absl::Seconds(3);
  std::vector<Link*> links{};  // that a server still has, the oldest first
  // How long nothing happened with a call that a server kept, and with one before it was ended for that.
  absl::Duration longest_idle = absl::ZeroDuration();
  absl::Duration shortest_idle = absl::InfiniteDuration();

  absl::Duration delay();
  bool cuts() { return cut_one_in > 0 && world.chance.one_in(cut_one_in); }
};

// Who takes a server's calls: the process that runs now, or null if nothing listens.
struct Listener {
  std::string name;
  std::shared_ptr<Process> process = nullptr;
  std::function<std::shared_ptr<ServerCall>(CallTransport&)> accept = nullptr;
};

class Link final : public CallTransport, public std::enable_shared_from_this<Link> {
 public:
  // `pass_on` is called in the client's process with each event, and with nothing else of the call after
  // kEnded. `listener` is asked when the call arrives. Everything outlives the link.
  static std::unique_ptr<ClientCall> begin(Network& network, Process& client,
                                           std::function<Listener()> listener,
                                           std::function<void(CallEvent)> pass_on);

  // The connection is lost. Each end learns of it within that time.
  void cut(absl::Duration client_learns, absl::Duration server_learns);
  // A proxy ends the call with OK, and drops the rest.
  void end_by_proxy();
  // The server's process ends, and with it everything of the call there.
  void end_server();
  const Process* server() const { return server_.get(); }
  // The server has opened the session, and neither ended it nor learned that the client is gone.
  bool is_open() const { return at_server_.opened && !at_server_.cancelled && !at_server_.end; }
  // The session has an open client that reads, and still does not leave the server, which drains for `time`.
  bool outstays(absl::Duration time) const;

  // The server's end.
  void start_read(grpc::ByteBuffer* message) override;
  void start_write(const grpc::ByteBuffer* message) override;
  void finish(const grpc::Status& status) override;
  void cancel() override;
  bool is_cancelled() const override { return at_server_.cancelled; }
  absl::Time deadline() const override { return absl::InfiniteFuture(); }
  std::string peer() const override { return client_.name(); }
  std::string identity(bool) const override { return client_.name(); }

  Link(Network& network, Process& client, std::function<void(CallEvent)> pass_on);

 private:
  class Caller;
  using Letter = std::optional<grpc::ByteBuffer>;  // none: the half-close
  // Messages that one end has sent and the other has not read. Each is on its way for a time of its own, and
  // none overtakes another.
  struct Way {
    static constexpr size_t kWindow = 3;
    size_t unread = 0;
    absl::Duration newest = absl::ZeroDuration();  // when the last one arrives
    std::deque<Letter> arrived;
    bool full() const { return unread >= kWindow; }
  };

  void arrive(const std::function<Listener()>& listener);
  void send(Way& way, Letter letter);
  void client_sends();
  // One of the ends may have an event.
  void look_at_client();
  void look_at_server();
  std::optional<CallEvent> client_event();
  bool server_event();
  void end_client(const grpc::Status& status, absl::Duration learns);
  void cancel_server(absl::Duration learns);
  void end_of_server();
  void something_happens();

  Network& network_;
  World& world_;
  Process& client_;
  const std::function<void(CallEvent)> pass_on_;
  bool cut_ = false;
  Way to_server_;
  Way to_client_;

  struct ClientEnd {
    bool started = false;  // the connection is there, or failed
    bool told_started = false;
    bool reading = true;
    bool writing = false;
    bool written = false;        // the write is over
    std::optional<Letter> sent;  // waits for room on the way
    bool connected = false;
    grpc::ByteBuffer message;
    std::optional<grpc::Status> status;  // arrived
    bool looking = false;
    bool over = false;
  };
  ClientEnd at_client_;

  std::shared_ptr<Process> server_;
  std::shared_ptr<ServerCall> call_;  // until it is done
  struct ServerEnd {
    grpc::ByteBuffer* reading = nullptr;
    const grpc::ByteBuffer* writing = nullptr;
    bool cancelled = false;
    bool told_cancelled = false;
    bool opened = false;                                  // the session
    std::optional<absl::Duration> leaves = std::nullopt;  // when it was told to
    absl::Duration newest = absl::ZeroDuration();         // when something happened last
    std::optional<grpc::Status> end;
    bool looking = false;
  };
  ServerEnd at_server_;
};

}  // namespace candela::testing
