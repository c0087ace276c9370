#include "server/grpc_listener.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <algorithm>
#include <climits>
#include <utility>

#include "server/access/client_identity.h"
#include "server/base/log.h"
#include "server/base/net/address.h"
#include "server/base/net/listening_socket.h"
#include "server/base/status_macros.h"
#include "server/memory_budget.h"

namespace candela {
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
