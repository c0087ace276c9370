#include "client/run/server/server_link.h"

#include <exception>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/base/system_failure.h"
#include "client/base/usage.h"
#include "client/retry.h"
#include "client/run/events.h"
#include "client/run/server/option_words.h"
#include "proto/candela/v1/limits.h"
#include "server/base/process/address_space.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// The deadline of calls that render nothing.
constexpr absl::Duration kAnswerTimeout = absl::Seconds(10);

absl::StatusOr<v1::GetServerInfoResponse> ask_info(const Connection& server) {
  absl::StatusOr<v1::GetServerInfoResponse> info = server.server_info(absl::Now() + kAnswerTimeout);
  if (!absl::IsDeadlineExceeded(info.status())) return info;
  // The next server is asked.
  return absl::UnavailableError(
      absl::StrFormat("no answer from %s within %s; it hangs or is not a candelad; name another server",
                      server.address(), absl::FormatDuration(kAnswerTimeout)));
}

}  // namespace

ServerLink::ServerLink(const ServerChoice& choice, RunEvents& events) : choice_(choice), events_(events) {
  if (!choice_.address.empty()) return;
  absl::Status room = check_address_space(server_bytes(), "the built-in server",
                                          ", or name a running candelad with --server");
  if (!room.ok()) {
    std::promise<Started> refused;
    refused.set_value(failure_of(FailureKind::kOther, room));
    starting_ = refused.get_future();
    return;
  }
  EmbeddedServer::prepare();
  starting_ = std::async(std::launch::async, [this]() -> Started {
    try {
      const absl::Time begin = absl::Now();
      Started server = EmbeddedServer::start(choice_);
      if (!server.ok()) return failure_of(FailureKind::kServer, server.status());
      start_ms_ = absl::ToDoubleMilliseconds(absl::Now() - begin);
      return server;
    } catch (const std::exception& error) {
      return failure_of(FailureKind::kOther, system_failure(error));
    }
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

absl::Status ServerLink::call(absl::Time deadline,
                              absl::FunctionRef<absl::Status(const Connection&)> one) const {
  RetryOptions options{.limit = choice_.resume_limit, .deadline = deadline};
  options.on_wait = [this](size_t server, const absl::Status& why, absl::Duration) {
    tell_of_wait(connections_[server].address(), why);
  };
  return of_server(
      retry(connections_.size(), options, [&](size_t server) { return one(connections_[server]); }));
}

void ServerLink::tell_of_wait(const std::string& server, const absl::Status& why) const {
  if (told_.exchange(true)) return;
  // The rest of the message tells the user what to do, which the command does.
  const std::string words(why.message());
  events_.note(absl::StrFormat("%s: %s; waiting for up to %s%s", server, words.substr(0, words.find(';')),
                               absl::FormatDuration(choice_.resume_limit),
                               choice_.takes_several ? " (--resume)" : ""));
}

absl::StatusOr<Session> ServerLink::open_session(const SessionOptions& session) {
  absl::StatusOr<Session> opened = open_one(session);
  if (opened.ok()) return opened;
  return of_server(opened.status());
}

absl::StatusOr<Session> ServerLink::open_one(const SessionOptions& session) {
  SessionOptions options = session;
  options.resume_limit = choice_.resume_limit;
  options.on_open_wait = [this](const std::string& server, const absl::Status& why) {
    tell_of_wait(server, why);
  };
  if (choice_.address.empty()) {
    ASSIGN_OR_RETURN(const Connection* server, connection());
    return Session::open({server->channel()}, options);
  }
  if (absl::Status room = check_address_space(session_bytes(), "a session", ""); !room.ok()) {
    return failure_of(FailureKind::kOther, room);
  }
  SessionOptions there = options;
  there.security = choice_.security;
  there.transport = choice_.transport;
  there.servers = addresses();
  return Session::open(there);
}

absl::StatusOr<v1::GetServerInfoResponse> ServerLink::info() {
  RETURN_IF_ERROR(connection().status());
  absl::StatusOr<v1::GetServerInfoResponse> info;
  RETURN_IF_ERROR(call(absl::InfiniteFuture(), [&info](const Connection& one) {
    info = ask_info(one);
    return info.status();
  }));
  return info;
}

absl::StatusOr<v1::Limits> ServerLink::limits() {
  if (choice_.address.empty()) {
    v1::Limits limits;
    limits.set_max_dimension(v1::kMaxDimension);
    limits.set_max_frame_bytes(v1::kDefaultMaxFrameBytes);
    return limits;
  }
  ASSIGN_OR_RETURN(const v1::GetServerInfoResponse server, info());
  return server.limits();
}

absl::Status ServerLink::check_tier(const std::string& tier) {
  if (tier.empty()) return absl::OkStatus();
  ASSIGN_OR_RETURN(const v1::GetServerInfoResponse server, info());
  std::vector<std::string> names;
  for (const v1::Tier& known : server.tiers()) {
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
