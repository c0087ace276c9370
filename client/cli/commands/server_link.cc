#include "client/cli/commands/server_link.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/options/usage.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {

// The deadline of calls that render nothing.
constexpr absl::Duration kAnswerTimeout = absl::Seconds(10);

absl::StatusOr<v1::GetServerInfoResponse> ask_info(const Connection& server) {
  absl::StatusOr<v1::GetServerInfoResponse> info = server.server_info(absl::Now() + kAnswerTimeout);
  if (!absl::IsDeadlineExceeded(info.status())) return info;
  return absl::DeadlineExceededError(
      absl::StrFormat("no answer from %s within %s; it hangs or is not a candelad; name another server",
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

std::vector<std::string> ServerLink::addresses() const {
  std::vector<std::string> all = {choice_.address};
  all.insert(all.end(), choice_.others.begin(), choice_.others.end());
  return all;
}

absl::StatusOr<const Connection*> ServerLink::connection() {
  if (!connections_.empty()) return &connections_.front();
  if (!choice_.address.empty()) {
    // Open all of them, so that a malformed address fails before any work is done.
    std::vector<Connection> opened;
    for (const std::string& address : addresses()) {
      absl::StatusOr<Connection> one = Connection::open(address, choice_.security);
      if (!one.ok()) return usage_error(std::string(one.status().message()));
      opened.push_back(*std::move(one));
    }
    connections_ = std::move(opened);
    return &connections_.front();
  }
  Started started = starting_.get();
  if (!started.ok()) return started.status();
  server_ = *std::move(started);
  connections_.emplace_back(server_->channel());
  return &connections_.front();
}

absl::StatusOr<Session> ServerLink::open_session(const SessionOptions& options) {
  if (choice_.address.empty()) {
    const absl::StatusOr<const Connection*> server = connection();
    if (!server.ok()) return server.status();
    return Session::open({(*server)->channel()}, options);
  }
  SessionOptions there = options;
  there.security = choice_.security;
  there.servers = addresses();
  return Session::open(there);
}

absl::StatusOr<v1::GetServerInfoResponse> ServerLink::info() {
  const absl::StatusOr<const Connection*> server = connection();
  if (!server.ok()) return server.status();
  absl::StatusOr<v1::GetServerInfoResponse> info = ask_info(**server);
  for (size_t i = 1; i < connections_.size() && !info.ok(); ++i) {
    if (auto answer = ask_info(connections_[i]); answer.ok()) info = std::move(answer);
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
  connections_.clear();
  server_.reset();
}

}  // namespace candela
