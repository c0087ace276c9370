#include "client/call/channel.h"

#include <grpcpp/create_channel.h>
#include <grpcpp/support/channel_arguments.h>
#include <grpcpp/support/status.h>

#include <algorithm>
#include <climits>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/internal/sysinfo.h"
#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "client/base/failure.h"
#include "client/call/retry_schedule.h"
#include "client/call/tls.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/address.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Plain words for what gRPC says in its own terms when its transport, and not a candelad, ended a call.

constexpr absl::string_view kHttpStatus = "Received http2 header with status: ";

// The words for the first sign that a message holds.
struct Translation {
  absl::string_view sign;
  absl::string_view words;
};

// The words after "cannot reach ADDRESS: ". A $ stands for the address.
constexpr Translation kUnreachable[] = {
    {"Domain name not found", "no machine has this name; check the name, or name another server"},
    {"DNS resolution failed", "its name cannot be looked up; check the name and this machine's network"},
    {"Connection refused",
     "nothing listens there; start one with candelad --listen $, or name another server"},
    {"No such file or directory",
     "there is no such socket; start one with candelad --listen $, or name another server"},
    {"Permission denied", "this user may not open it; ask the operator of the server for access"},
    {"unreachable", "no network leads there; check the address and this machine's network"},
    {"No route to host", "no network leads there; check the address and this machine's network"},
    {"imed out", "it does not answer; check the address and the firewalls on the way"},
    {"imeout", "it does not answer; check the address and the firewalls on the way"},
    {"parsing HTTP/2", "it does not speak gRPC; check the port, because a candelad listens on another one"},
    {"http1.x", "it does not speak gRPC; check the port, because a candelad listens on another one"},
    {"ocket closed",
     "it closed the connection at once; it is not a candelad, "
     "or the --tls options are not those that it needs"},
    {"onnection reset",
     "it closed the connection at once; it is not a candelad, "
     "or the --tls options are not those that it needs"},
    {"andshake", "it and this client agree on no TLS; check the --tls options"},
};

constexpr Translation kLost[] = {
    {"ocket closed", "it closed the connection"}, {"onnection reset", "the connection was cut"},
    {"roken pipe", "it closed the connection"},   {"GOAWAY", "it is stopping"},
    {"keepalive", "it no longer answers"},        {"ping timeout", "it no longer answers"},
    {"imed out", "it no longer answers"},         {"RST_STREAM", "it broke the call off"},
    {"Stream removed", "it broke the call off"},  {"No status received", "it broke the call off"},
};

template <size_t kSize>
absl::string_view translated(const Translation (&table)[kSize], absl::string_view message) {
  for (const Translation& row : table) {
    if (absl::StrContains(message, row.sign)) return row.words;
  }
  return "";
}

absl::Status http_error(const std::string& address, absl::string_view message) {
  const absl::string_view code =
      message.substr(message.find(kHttpStatus) + kHttpStatus.size(), absl::string_view("404").size());
  if (code == "502" || code == "503" || code == "504") {
    return absl::UnavailableError(
        absl::StrFormat("%s is a proxy that reaches no candelad now (HTTP status %s); check the servers "
                        "behind it, or try again",
                        address, code));
  }
  if (code == "401" || code == "403") {
    return absl::PermissionDeniedError(absl::StrFormat(
        "%s is a proxy that lets this client through to no candelad (HTTP status %s); ask its operator",
        address, code));
  }
  return absl::UnimplementedError(absl::StrFormat(
      "%s is a web server and no candelad (HTTP status %s); check the address and the port", address, code));
}

// Why the server at `address` cannot be reached, and what to do.
std::string unreachable_words(const std::string& address, absl::string_view grpc_message) {
  const absl::string_view words = translated(kUnreachable, grpc_message);
  if (words.empty()) {
    return absl::StrFormat("cannot reach %s; check the address, or name another server (gRPC says: %s)",
                           address, grpc_message);
  }
  return absl::StrCat("cannot reach ", address, ": ", absl::StrReplaceAll(words, {{"$", address}}));
}

// Why the connection to a server is lost: "it closed the connection".
std::string loss_words(absl::string_view grpc_message) {
  const absl::string_view words = translated(kLost, grpc_message);
  return words.empty() ? absl::StrCat("gRPC says: ", grpc_message) : std::string(words);
}

// The error for a status that HTTP or gRPC itself gave the call, such as "Received http2 header with status:
// 404". Nothing if it may be the server's own.
std::optional<absl::Status> not_from_candelad(const std::string& address, const grpc::Status& status) {
  const std::string& message = status.error_message();
  if (absl::StrContains(message, kHttpStatus)) return http_error(address, message);
  switch (status.error_code()) {
    case grpc::UNIMPLEMENTED:
      return absl::UnimplementedError(
          absl::StrFormat("%s does not know this call: it is an older candelad, "
                          "or another program; update it, or check the address",
                          address));
    case grpc::RESOURCE_EXHAUSTED:
      if (!absl::StrContains(message, "message larger than max")) return std::nullopt;
      return failure_of(FailureKind::kServer, absl::ResourceExhaustedError(absl::StrFormat(
                                                  "a message was larger than %s or this client takes; update "
                                                  "the older one of them (gRPC says: %s)",
                                                  address, message)));
    case grpc::INTERNAL:
    case grpc::UNKNOWN:
      if (translated(kLost, message).empty()) return std::nullopt;
      return absl::UnavailableError(
          absl::StrFormat("lost the server at %s: %s; it may have stopped, so check its log and try again",
                          address, loss_words(message)));
    default:
      return std::nullopt;
  }
}

constexpr int kFirstReconnectMs = 100;
constexpr int kSlowestReconnectMs = 1000;
constexpr int kFastestPingMs = 1000;  // gRPC does not ping more often

bool is_address(const std::string& address) {
  const std::optional<HostPort> at = parse_host_port(address);
  return is_unix_address(address) || (at && at->port >= 1);
}

// What somebody means who writes a port, a URL, a path or a bare IPv6 address; "" if that is unknown.
std::string meant_address(absl::string_view address) {
  if (address.find_first_not_of("0123456789") == absl::string_view::npos && !address.empty()) {
    return absl::StrCat("; on this machine it is 127.0.0.1:", address);
  }
  if (absl::ConsumePrefix(&address, "http://") || absl::ConsumePrefix(&address, "https://") ||
      absl::ConsumePrefix(&address, "grpc://")) {
    return absl::StrCat("; leave out what stands before ", address);
  }
  if (absl::StrContains(address, '/')) return absl::StrCat("; a socket is unix:", address);
  const bool is_ipv6 = std::count(address.begin(), address.end(), ':') > 1 &&
                       address.find_first_not_of("0123456789abcdefABCDEF:.") == absl::string_view::npos;
  return is_ipv6 ? absl::StrCat("; an IPv6 address has brackets, [", address, "]:50051") : "";
}

absl::StatusOr<std::shared_ptr<grpc::Channel>> open_with(const Peer& peer, absl::Duration ping_interval,
                                                         grpc::ChannelArguments arguments) {
  const std::string& address = peer.address;
  if (!is_address(address)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("server address '%s' is neither HOST:PORT (port 1 .. 65535) nor unix:PATH%s", address,
                        meant_address(address)));
  }
  ASSIGN_OR_RETURN(auto credentials, channel_credentials(address, peer.security, arguments));
  // Connect to the server itself, even if the environment names a proxy.
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  // A server that is started again is soon found.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, kFirstReconnectMs);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, kSlowestReconnectMs);
  // Without pings, a call would wait for ever for a server that lost its power, and sometimes for one that
  // reset the connection right after its last bytes. server/grpc_listener.cc says why gRPC may miss that.
  const auto ping_ms = static_cast<int>(
      std::clamp<int64_t>(absl::ToInt64Milliseconds(ping_interval), kFastestPingMs, INT_MAX));
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, ping_ms);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, ping_ms);
  // A call may have nothing to send for a long time.
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  arguments.SetMaxReceiveMessageSize(static_cast<int>(v1::kMaxMessageBytes));
  // gRPC 1.51 reads the errno of connect() only after locks (github.com/grpc/grpc/pull/35064).
  // The first lock that has to wait counts the processors, and sets errno where /sys is not mounted. So they
  // are counted before; else one connection in 500 fails there.
  absl::base_internal::NumCPUs();
  return grpc::CreateCustomChannel(address, credentials, arguments);
}

absl::Status in_words(const grpc::Status& status, const Peer& peer, bool connected) {
  const std::string& address = peer.address;
  const absl::Status plain(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
  const std::string message(plain.message().empty() ? absl::StatusCodeToString(plain.code())
                                                    : std::string(plain.message()));
  // A server's own refusal has details. Without details the error is the transport's.
  if (status.error_details().empty()) {
    if (std::optional<absl::Status> error = not_from_candelad(address, status)) return *std::move(error);
  }
  switch (status.error_code()) {
    case grpc::UNAVAILABLE:
      if (!status.error_details().empty()) break;
      if (connected) {
        return absl::UnavailableError(
            absl::StrFormat("lost the server at %s: %s; it may have stopped, so check its log and try again",
                            address, loss_words(message)));
      }
      if (may_be_about_tls(message)) {
        const std::string why = why_tls_fails(address, peer.security);
        if (!why.empty()) return absl::UnavailableError(why);
      }
      return absl::UnavailableError(unreachable_words(address, message));
    case grpc::CANCELLED:
      // The client never cancels. The server does, through gRPC when it stops and when its idle timeout
      // passes.
      return absl::UnavailableError(
          absl::StrFormat("the server at %s ended the call: it is stopping, or the client read nothing for "
                          "longer than its --idle-timeout; try again",
                          address));
    case grpc::DEADLINE_EXCEEDED:
      if (message != "Deadline Exceeded") break;
      return absl::DeadlineExceededError(absl::StrFormat(
          "no answer from %s in the time given: it is busy, hangs or is not a candelad; allow more "
          "time, or name another server",
          address));
    case grpc::UNAUTHENTICATED:
      // The server's answer is the same for a missing token and for one that it does not know.
      if (peer.security.token_file.empty()) break;
      return absl::UnauthenticatedError(absl::StrFormat(
          "%s does not accept the token in %s; ask its operator for a token that it knows, and "
          "name its file with --token-file",
          address, peer.security.token_file));
    default:
      break;
  }
  return absl::Status(plain.code(), message);
}

}  // namespace

absl::Status check_frame(uint32_t width, uint32_t height, v1::PixelFormat format, size_t bytes) {
  if (width == 0 || height == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame is %dx%d pixels; it must be at least 1x1", width, height));
  }
  if (bytes != uint64_t{width} * height * bytes_per_pixel(format)) {
    return absl::InvalidArgumentError(absl::StrFormat("%dx%d pixels of %s are not %d bytes", width, height,
                                                      v1::PixelFormat_Name(format), bytes));
  }
  return absl::OkStatus();
}

absl::Status check_view(uint32_t width, uint32_t height, size_t bytes) {
  if (bytes != 0)
    return absl::InvalidArgumentError("a frame has both pixels and a view; it takes one of them");
  if (width == 0 || height == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("view is %dx%d pixels; it must be at least 1x1", width, height));
  }
  return absl::OkStatus();
}

uint64_t rows_of_band(uint64_t row_bytes) {
  return std::max<uint64_t>(1, v1::kMaxBandBytes / std::max<uint64_t>(1, row_bytes));
}

absl::StatusOr<std::shared_ptr<grpc::Channel>> open_channel(const Peer& peer) {
  return open_with(peer, kPingInterval, {});
}

absl::StatusOr<std::shared_ptr<grpc::Channel>> open_session_channel(const Peer& peer,
                                                                    absl::Duration ping_interval) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return open_with(peer, ping_interval, std::move(arguments));
}

absl::Status from_grpc(const grpc::Status& status, const Peer& peer, bool connected) {
  if (status.ok()) return absl::OkStatus();
  absl::Status error = in_words(status, peer, connected);
  if (connected && absl::IsUnavailable(error)) set_retry_delay(error, retry_delay(status));
  return error;
}

}  // namespace candela
