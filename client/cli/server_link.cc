#include "client/cli/server_link.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/usage.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {

// For what needs no rendering.
constexpr absl::Duration kAnswerTimeout = absl::Seconds(10);

absl::StatusOr<v1::GetServerInfoResponse> ask_info(const Connection& server) {
  absl::StatusOr<v1::GetServerInfoResponse> info = server.server_info(absl::Now() + kAnswerTimeout);
  if (!absl::IsDeadlineExceeded(info.status())) return info;
  return absl::DeadlineExceededError(
      absl::StrFormat("no answer from %s within %s: it hangs or is not a candelad; name another --server or "
                      "none",
                      server.address(), absl::FormatDuration(kAnswerTimeout)));
}

}  // namespace

ServerLink::ServerLink(const ServerChoice& choice) : choice_(choice) {
  if (!choice_.address.empty()) return;
  EmbeddedServer::prepare();
  starting_ = std::async(std::launch::async, [this]() -> Started {
    const absl::Time begin = absl::Now();
    Started server = EmbeddedServer::start(choice_.device);
    start_ms_ = absl::ToDoubleMilliseconds(absl::Now() - begin);
    return server;
  });
}

absl::StatusOr<const Connection*> ServerLink::connection() {
  if (connection_) return &*connection_;
  if (!choice_.address.empty()) {
    absl::StatusOr<Connection> opened = Connection::open(choice_.address, choice_.security);
    if (!opened.ok()) return usage_error(std::string(opened.status().message()));
    for (const std::string& address : choice_.others) {
      const absl::StatusOr<Connection> other = Connection::open(address, choice_.security);
      if (!other.ok()) return usage_error(std::string(other.status().message()));
    }
    connection_ = *std::move(opened);
    return &*connection_;
  }
  Started started = starting_.get();
  if (!started.ok()) return started.status();
  server_ = *std::move(started);
  connection_.emplace(server_->channel());
  return &*connection_;
}

absl::StatusOr<Session> ServerLink::open_session(const SessionOptions& options) {
  if (choice_.address.empty()) {
    const absl::StatusOr<const Connection*> server = connection();
    if (!server.ok()) return server.status();
    return Session::open({(*server)->channel()}, options);
  }
  SessionOptions there = options;
  there.security = choice_.security;
  there.servers = {choice_.address};
  there.servers.insert(there.servers.end(), choice_.others.begin(), choice_.others.end());
  return Session::open(there);
}

absl::StatusOr<v1::GetServerInfoResponse> ServerLink::info() {
  const absl::StatusOr<const Connection*> server = connection();
  if (!server.ok()) return server.status();
  absl::StatusOr<v1::GetServerInfoResponse> info = ask_info(**server);
  for (const std::string& address : choice_.others) {
    if (info.ok()) break;
    const absl::StatusOr<Connection> other = Connection::open(address, choice_.security);
    if (!other.ok()) return usage_error(std::string(other.status().message()));
    if (auto answer = ask_info(*other); answer.ok()) info = std::move(answer);
  }
  return info;
}

absl::StatusOr<v1::Limits> ServerLink::limits() {
  if (choice_.address.empty()) {
    v1::Limits limits;
    limits.set_max_dimension(v1::kMaxDimension);
    limits.set_max_frame_bytes(v1::kDefaultMaxFrameBytes);
    return limits;
  }
  const absl::StatusOr<v1::GetServerInfoResponse> server = info();
  if (!server.ok()) return server.status();
  return server->limits();
}

absl::Status ServerLink::check_tier(const std::string& tier) {
  if (tier.empty()) return absl::OkStatus();
  const absl::StatusOr<v1::GetServerInfoResponse> server = info();
  if (!server.ok()) return server.status();
  std::vector<std::string> names;
  for (const v1::Tier& known : server->tiers()) {
    if (known.name() == tier) return absl::OkStatus();
    names.push_back(known.name());
  }
  return unknown_word("tier", tier, names);
}

void ServerLink::close() {
  if (starting_.valid()) starting_.wait();
  starting_ = {};
  connection_.reset();
  server_.reset();
}

}  // namespace candela
