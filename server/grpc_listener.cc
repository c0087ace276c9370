#include "server/grpc_listener.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <algorithm>
#include <climits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "proto/candela/v1/address.h"
#include "server/listen_address.h"
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

constexpr int kMaxThreads = 16;    // of gRPC's synchronous services
constexpr int kOtherStreams = 64;  // on one connection, in addition to calls with frames

void set_limits(grpc::ServerBuilder& builder, const Config& config) {
  builder.SetMaxReceiveMessageSize(static_cast<int>(v1::kMaxMessageBytes));
  builder.SetMaxSendMessageSize(static_cast<int>(v1::kMaxMessageBytes));
  // A compressed message could expand to far more than the limit.
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_GZIP, false);
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_DEFLATE, false);
  // Otherwise two servers on one port would silently share its calls.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  // Reflection is a synchronous service and takes one thread per stream; a health watch never ends.
  grpc::ResourceQuota quota("candelad");
  quota.SetMaxThreads(kMaxThreads);
  builder.SetResourceQuota(quota);
  // Only this limits the unread bytes inside gRPC. A memory quota would end calls instead of slowing clients
  // down.
  builder.AddChannelArgument(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, kLookAheadBytes);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS,
                             static_cast<int>(config.max_calls + config.max_sessions) + kOtherStreams);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kPingIntervalMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, INT_MAX);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS,
                             static_cast<int>(absl::ToInt64Milliseconds(
                                 std::clamp(config.idle_timeout, kHandshake.min, kHandshake.max))));
}

// Replaces port 0 by the port that was picked.
std::string with_port(const std::string& address, int port) {
  if (v1::is_unix_address(address)) return address;
  return absl::StrCat(address.substr(0, address.rfind(':') + 1), port);
}

}  // namespace

absl::StatusOr<GrpcListener> start_grpc(const Config& config, Access& access, Metrics& metrics,
                                        grpc::Service& service) {
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  builder.RegisterService(&service);
  set_limits(builder, config);
  std::vector<int> ports(config.listen.size(), 0);
  for (const std::string& address : config.listen) {
    if (absl::Status status = check_socket_is_free(address); !status.ok()) return status;
  }
  for (size_t i = 0; i < ports.size(); ++i) {
    builder.AddListeningPort(config.listen[i], access.credentials(config.listen[i], metrics), &ports[i]);
  }
  GrpcListener listener{.server = builder.BuildAndStart(), .addresses = {}};
  for (size_t i = 0; i < ports.size(); ++i) {
    if (ports[i] == 0) {
      return absl::UnavailableError(
          absl::StrFormat("cannot listen on %s: the address is in use or does not belong to this machine; "
                          "stop the program that listens there or pass another --listen",
                          config.listen[i]));
    }
    listener.addresses.push_back(with_port(config.listen[i], ports[i]));
  }
  if (listener.server == nullptr) return absl::InternalError("gRPC did not start");
  return listener;
}

}  // namespace candela
