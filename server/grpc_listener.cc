#include "server/grpc_listener.h"

#include <fcntl.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <optional>
#include <string>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/string_view.h"
#include "server/access/client_identity.h"
#include "server/base/address.h"
#include "server/base/listening_socket.h"
#include "server/base/log.h"
#include "server/base/status_macros.h"
#include "server/memory_budget.h"

namespace candela {
namespace {

// The client's preface of HTTP/2 and an empty SETTINGS frame (RFC 9113, 3.4).
constexpr absl::string_view kPreface{"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\4\0\0\0\0\0", 33};

constexpr int kStepMs = 20;  // between looks at the end of the thread

socklen_t size_of(const sockaddr_storage& address) {
  return address.ss_family == AF_UNIX   ? sizeof(sockaddr_un)
         : address.ss_family == AF_INET ? sizeof(sockaddr_in)
                                        : sizeof(sockaddr_in6);
}

}  // namespace

OwnDoor::OwnDoor(std::vector<Address> addresses, Clock& clock, const Options& options,
                 std::function<void(State)> report)
    : addresses_(std::move(addresses)),
      clock_(clock),
      options_(options),
      report_(std::move(report)),
      tls_(SSL_CTX_new(TLS_client_method()), SSL_CTX_free),
      stop_(clock),
      thread_([this] { run(); }) {}

OwnDoor::~OwnDoor() {
  stop_.give();
  thread_.join();
}

void OwnDoor::run() {
  State told;
  absl::Duration deaf_for = absl::ZeroDuration();
  while (!stop_.comes_within(options_.interval)) {
    const absl::Time begin = clock_.now();
    bool all = true;
    for (const Address& address : addresses_) all = all && answers(address);
    const absl::Duration waited =
        std::min(clock_.now() - begin, options_.interval * static_cast<double>(addresses_.size()));
    deaf_for = all ? absl::ZeroDuration() : deaf_for + options_.interval + waited;
    const State state{deaf_for < options_.limit, deaf_for < options_.dead_limit};
    if (state != told && !stop_.is_given()) report_(told = state);
  }
}

bool OwnDoor::answers(const Address& address) {
  const absl::Time end = clock_.now() + options_.interval;
  const int connection = socket(address.at.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (connection < 0) return false;
  const absl::Cleanup close_it = [connection] { close(connection); };
  if (connect(connection, reinterpret_cast<const sockaddr*>(&address.at), size_of(address.at)) != 0) {
    if (errno != EINPROGRESS || !wait_for(connection, POLLOUT, end)) return false;
    int error = 0;
    socklen_t size = sizeof error;
    getsockopt(connection, SOL_SOCKET, SO_ERROR, &error, &size);
    if (error != 0) return false;
  }
  if (address.tls && tls_ != nullptr) {
    const std::unique_ptr<SSL, decltype(&SSL_free)> client(SSL_new(tls_.get()), SSL_free);
    if (client == nullptr || SSL_set_fd(client.get(), connection) != 1) return false;
    SSL_connect(client.get());  // sends its first message
  } else if (send(connection, kPreface.data(), kPreface.size(), MSG_NOSIGNAL) < 0) {
    return errno == ECONNRESET || errno == EPIPE;  // closed without an answer
  }
  return wait_for(connection, POLLIN, end);
}

bool OwnDoor::wait_for(int connection, int16_t events, absl::Time end) {
  while (clock_.now() < end && !stop_.is_given()) {
    pollfd wait{connection, events, 0};
    const int ready = poll(&wait, 1, kStepMs);
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
  }
  return false;
}

namespace {

constexpr int kWithoutDescriptorMs = 20;  // before the next attempt
constexpr int kAtATime = 64;              // connections of one door, before the next door's turn

int open_spare() { return open("/dev/null", O_RDONLY | O_CLOEXEC); }

const char* word(ConnectionRefusal reason) {
  return reason == ConnectionRefusal::kLimit ? "max-connections are open" : "no file descriptor is left";
}

}  // namespace

void OpenConnections::add(int descriptor, std::string client) {
  struct stat about {};
  if (fstat(descriptor, &about) != 0) return;
  const absl::MutexLock lock(&mutex_);
  // Doubling the limit keeps this cheap: a constant time for each connection on average.
  if (known_.size() >= look_at_) {
    forget_closed();
    look_at_ = std::max(look_at_, 2 * known_.size());
  }
  known_.push_back({descriptor, about.st_ino, std::move(client)});
}

size_t OpenConnections::count() {
  const absl::MutexLock lock(&mutex_);
  forget_closed();
  return known_.size();
}

bool OpenConnections::has(const std::string& client) const {
  const absl::MutexLock lock(&mutex_);
  return std::any_of(known_.begin(), known_.end(),
                     [&](const Known& known) { return known.client == client; });
}

std::set<std::string> OpenConnections::clients() {
  const absl::MutexLock lock(&mutex_);
  forget_closed();
  std::set<std::string> clients;
  for (const Known& known : known_) clients.insert(known.client);
  return clients;
}

void OpenConnections::forget_closed() {
  std::erase_if(known_, [](const Known& known) {
    struct stat about {};
    // Its number may have been used again, so the inode has to be the same.
    return fstat(known.descriptor, &about) != 0 || about.st_ino != known.inode || !S_ISSOCK(about.st_mode);
  });
}

AcceptLoop::AcceptLoop(std::vector<Door> doors, size_t max_connections, OpenConnections& connections,
                       Metrics& metrics, Clock& clock)
    : doors_(std::move(doors)),
      max_connections_(max_connections),
      connections_(connections),
      metrics_(metrics),
      clock_(clock),
      spare_(open_spare()),
      stop_(eventfd(0, EFD_CLOEXEC)),
      thread_([this] { run(); }) {}

AcceptLoop::~AcceptLoop() {
  eventfd_write(stop_, 1);
  thread_.join();
  close(stop_);
  if (spare_ >= 0) close(spare_);
}

void AcceptLoop::run() {
  std::vector<pollfd> waits;
  for (const Door& door : doors_) waits.push_back({door.socket.descriptor(), POLLIN, 0});
  waits.push_back({stop_, POLLIN, 0});
  for (;;) {
    if (poll(waits.data(), waits.size(), -1) < 0) continue;
    if (waits.back().revents != 0) return;
    for (size_t i = 0; i < doors_.size(); ++i) {
      for (int n = 0; waits[i].revents != 0 && n < kAtATime && accept_one(doors_[i]); ++n) {
      }
    }
  }
}

bool AcceptLoop::accept_one(const Door& door) {
  const int descriptor = accept4(door.socket.descriptor(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (descriptor >= 0) {
    if (is_full()) {
      refuse(descriptor, ConnectionRefusal::kLimit);
    } else {
      ++at_most_;
      connections_.add(descriptor);
      door.take(descriptor);
    }
    return true;
  }
  if (errno == EAGAIN) return false;
  if (errno == EMFILE || errno == ENFILE) {
    accept_without_descriptor(door);
  } else if (errno == ENOBUFS || errno == ENOMEM) {
    poll(nullptr, 0, kWithoutDescriptorMs);
  }
  return false;  // or the client has gone already
}

void AcceptLoop::accept_without_descriptor(const Door& door) {
  // Without this the connection would stay in the kernel's queue, and poll() would return at once for ever.
  if (spare_ >= 0) {
    close(std::exchange(spare_, -1));
    const int descriptor = accept4(door.socket.descriptor(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (descriptor >= 0) refuse(descriptor, ConnectionRefusal::kDescriptors);
  }
  spare_ = open_spare();
  // Another thread took the descriptor; without this wait the loop would spin until it gives one back.
  if (spare_ < 0) poll(nullptr, 0, kWithoutDescriptorMs);
}

void AcceptLoop::refuse(int descriptor, ConnectionRefusal reason) {
  metrics_.connection_refused(reason);
  if (const std::optional<uint64_t> connections = lines_.pass(clock_.now())) {
    log_event(LogLevel::kWarning, "connection refused",
              {{"reason", word(reason)},
               {"peer", client_of(descriptor)},
               {"connections", *connections},
               {"max_connections", uint64_t{max_connections_}}});
  }
  close(descriptor);
}

bool AcceptLoop::is_full() {
  // count() looks at every connection, so only if the estimate reaches the limit.
  if (at_most_ >= max_connections_) at_most_ = connections_.count();
  return at_most_ >= max_connections_;
}

namespace {

// The time limit for a connection's first bytes is the idle timeout within this range. The minimum leaves
// time for a busy machine; the maximum is gRPC's own limit.
constexpr v1::Range<absl::Duration> kHandshake{absl::Seconds(3), absl::Minutes(2)};

// Clients may ping once a second (SessionOptions::ping_interval). This leaves some tolerance.
constexpr int kPingIntervalMs = 500;

// The interval between pings on a silent connection. gRPC trusts the kernel when it says that everything was
// read, and the kernel says so of a connection that was reset right after its last bytes (TCP_INQ). Only a
// write reveals the reset. The idle timeouts limit the wait for an answer, because the answer may have to
// wait behind a frame.
constexpr int kKeepaliveMs = 5000;

// A connection without a call is ended after this many idle timeouts, within this range. Clients connect
// again by themselves when they make a call.
constexpr int kIdleTimeouts = 5;
constexpr v1::Range<absl::Duration> kIdle{absl::Seconds(10), absl::Hours(24)};

constexpr int kFirstWindowBytes = 4 << 20;

constexpr int kMaxThreads = 16;    // of gRPC's synchronous services
constexpr int kOtherStreams = 64;  // on one connection, in addition to calls with frames

}  // namespace

absl::Duration handshake_limit(const Config& config) {
  return std::clamp(config.idle_timeout, kHandshake.min, kHandshake.max);
}

namespace {

void set_limits(grpc::ServerBuilder& builder, const Config& config) {
  builder.SetMaxReceiveMessageSize(static_cast<int>(v1::kMaxMessageBytes));
  builder.SetMaxSendMessageSize(static_cast<int>(v1::kMaxMessageBytes));
  // A compressed message could expand to far more than the limit.
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_GZIP, false);
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_DEFLATE, false);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS,
                             static_cast<int>(absl::ToInt64Milliseconds(
                                 std::clamp(kIdleTimeouts * config.idle_timeout, kIdle.min, kIdle.max))));
  // Reflection is a synchronous service and takes one thread per stream; a health watch never ends.
  grpc::ResourceQuota quota("candelad");
  quota.SetMaxThreads(kMaxThreads);
  // HTTP/2's windows grow with bandwidth times round-trip time, to at most 32 MiB. With a fixed window a
  // client that is far away sends a frame in small pieces, and waits for an answer after each. When four
  // fifths of the quota are taken, gRPC makes all windows smaller.
  quota.Resize(grpc_quota_bytes(config.max_sessions, config.max_calls));
  builder.SetResourceQuota(quota);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_BDP_PROBE, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, kFirstWindowBytes);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS,
                             static_cast<int>(config.max_calls + config.max_sessions) + kOtherStreams);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kPingIntervalMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, INT_MAX);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS,
                             static_cast<int>(absl::ToInt64Milliseconds(handshake_limit(config))));
}

// gRPC does not tell the check of a token who calls over TCP, only at which of its ports. So such an address
// has so many of them, and all connections of a client use the same. While no more clients than this are
// connected, each has one for itself.
constexpr size_t kPortsForTokens = 64;

// The ports of gRPC behind one listening address. One thread at a time.
class Ports {
 public:
  Ports(grpc::ServerBuilder& builder, const Config& config, const std::string& address, Access& access,
        Metrics& metrics) {
    const bool by_client = !config.token_file.empty() && !is_unix_address(address);
    ports_.resize(by_client ? kPortsForTokens : 1);
    for (Port& port : ports_) {
      port.acceptor = builder.experimental().AddExternalConnectionAcceptor(
          grpc::ServerBuilder::experimental_type::ExternalConnectionType::FROM_FD,
          access.credentials(address, metrics, [open = port.open] { return open->clients(); }));
    }
  }

  // Hands over a connection that `listening` accepted.
  void take(int listening, int descriptor) {
    const Port& port = ports_.size() == 1 ? ports_.front() : choose(descriptor);
    grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters connection;
    connection.listener_fd = listening;
    connection.fd = descriptor;
    port.acceptor->HandleNewConnection(&connection);
  }

 private:
  struct Port {
    std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> acceptor;
    std::shared_ptr<OpenConnections> open = std::make_shared<OpenConnections>();
  };

  const Port& choose(int descriptor) {
    std::string client = client_of(descriptor);
    auto port =
        std::find_if(ports_.begin(), ports_.end(), [&](const Port& p) { return p.open->has(client); });
    if (port == ports_.end()) {
      std::vector<size_t> open;
      for (const Port& p : ports_) open.push_back(p.open->count());
      port = ports_.begin() + (std::min_element(open.begin(), open.end()) - open.begin());
    }
    port->open->add(descriptor, std::move(client));
    return *port;
  }

  std::vector<Port> ports_;
};

// Listens at `address` and hands what is accepted there to `builder`'s server, once that has started.
absl::Status open_doors(const Config& config, const std::string& address, grpc::ServerBuilder& builder,
                        Access& access, Metrics& metrics, GrpcListener& listener,
                        std::vector<AcceptLoop::Door>& doors) {
  ASSIGN_OR_RETURN(std::vector<ListeningSocket> sockets, ListeningSocket::listen("listen", address));
  listener.addresses.push_back(sockets.front().address());
  const auto ports = std::make_shared<Ports>(builder, config, address, access, metrics);
  const bool tls = !config.tls_cert.empty() && !is_unix_address(address);
  for (ListeningSocket& socket : sockets) {
    listener.own_doors.push_back({socket.local(), tls});
    const int listening = socket.descriptor();
    doors.push_back(
        {std::move(socket), [ports, listening](int descriptor) { ports->take(listening, descriptor); }});
  }
  return absl::OkStatus();
}

void open_memory_door(const std::string& address, MemoryDoor& memory, std::vector<AcceptLoop::Door>& doors) {
  absl::StatusOr<std::vector<ListeningSocket>> sockets =
      ListeningSocket::listen("listen", address + v1::kMemorySuffix);
  if (!sockets.ok()) {
    log_event(LogLevel::kWarning, "no shared memory", {{"message", sockets.status().message()}});
    return;
  }
  doors.push_back({std::move(sockets->front()), [&memory](int descriptor) { memory.take(descriptor); }});
}

}  // namespace

absl::StatusOr<GrpcListener> start_grpc(const Config& config, uint32_t max_connections,
                                        OpenConnections& connections, Access& access, Metrics& metrics,
                                        grpc::Service& service, Clock& clock, MemoryDoor* memory) {
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  builder.RegisterService(&service);
  set_limits(builder, config);
  GrpcListener listener;
  std::vector<AcceptLoop::Door> doors;
  for (const std::string& address : config.listen) {
    if (absl::Status status = open_doors(config, address, builder, access, metrics, listener, doors);
        !status.ok()) {
      return status;
    }
    if (memory != nullptr && is_unix_address(address)) open_memory_door(address, *memory, doors);
  }
  listener.server = builder.BuildAndStart();
  if (listener.server == nullptr) return absl::InternalError("gRPC did not start");
  if (!doors.empty()) {
    listener.accepting =
        std::make_unique<AcceptLoop>(std::move(doors), max_connections, connections, metrics, clock);
  }
  return listener;
}

}  // namespace candela
