#include "client/call/transport_words.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/base/failure.h"

namespace candela {
namespace {

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

}  // namespace

std::string unreachable_words(const std::string& address, absl::string_view grpc_message) {
  const absl::string_view words = translated(kUnreachable, grpc_message);
  if (words.empty()) {
    return absl::StrFormat("cannot reach %s; check the address, or name another server (gRPC says: %s)",
                           address, grpc_message);
  }
  return absl::StrCat("cannot reach ", address, ": ", absl::StrReplaceAll(words, {{"$", address}}));
}

std::string loss_words(absl::string_view grpc_message) {
  const absl::string_view words = translated(kLost, grpc_message);
  return words.empty() ? absl::StrCat("gRPC says: ", grpc_message) : std::string(words);
}

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

}  // namespace candela
