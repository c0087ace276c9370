#include "client/run/server_link.h"

#include <algorithm>
#include <exception>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/retry.h"
#include "client/run/events.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"
#include "server/base/process.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// A field's name in a refusal, and the option that sets it.
struct Name {
  std::string field;
  std::string option;
};

// Fields of calls and sessions, which render.proto declares no options for.
constexpr std::pair<const char*, const char*> kCallFields[] = {
    {"open.session", "--session"},
    {"open.lookahead", "--lookahead"},
    {"open.cut_threshold_ev", "--detect-cuts"},
    {"open.jpeg_quality", "--quality"},
    {"open.encoding", "--encoding"},
    {"open.state", "--state"},
    {"encoding", "--encoding"},
    {"jpeg_quality", "--quality"},
    {"previous.exposure", "--previous-exposure"},
    {"previous.elapsed_seconds", "--elapsed"},
    {"frame.exposure", "the frame's exposure"},
    {"frame.media_time_ns", "the frame's media time"},
    {"output_format", "the output's format"},
    {"table", "the view's table"},
    {"view.camera.fov_deg", "--fov"},
    {"view.camera.yaw_deg", "--yaw"},
    {"view.camera.pitch_deg", "--pitch"},
    {"view.camera.roll_deg", "--roll"},
    {"view.rotation_deg", "--rotation"},
    {"view.objects", "--objects"},
    {"view.samples", "--samples"},
    {"rotation_deg", "--rotation"},
    {"roughness_mapping", "--roughness-mapping"},
};

std::vector<Name> names_for(const v1::Settings& given) {
  std::vector<Name> names;
  for (const v1::SettingField& setting : v1::setting_fields()) {
    const std::string& flag = setting.declaration().flag();
    if (!flag.empty()) names.push_back({setting.path, "--" + flag});
  }
  for (const auto& [field, option] : kCallFields) names.push_back({field, option});
  // Without the option they are the file's own.
  names.push_back({"input_chromaticities",
                   given.has_input_chromaticities() ? "--primaries" : "the file's chromaticities"});
  // The longest name that fits is the one that is meant.
  std::sort(names.begin(), names.end(),
            [](const Name& a, const Name& b) { return a.field.size() > b.field.size(); });
  return names;
}

bool in_name(char c) { return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '-'; }

// True if `text` begins with this name and means the field by it. Names such as "curve" are also words, and
// mean the field if its value follows.
bool means(absl::string_view text, const Name& name) {
  if (!absl::ConsumePrefix(&text, name.field)) return false;
  if (!text.empty() && in_name(text[0])) return false;
  if (text.size() > 1 && text[0] == '.' && in_name(text[1])) return false;
  return name.field.find_first_of("._") != std::string::npos || absl::StartsWith(text, " is ");
}

// The field that begins at `at`. Null: none.
const Name* name_at(const std::vector<Name>& names, absl::string_view text, size_t at) {
  if (at > 0 && (in_name(text[at - 1]) || text[at - 1] == '.')) return nullptr;
  const auto found = std::find_if(names.begin(), names.end(),
                                  [&](const Name& name) { return means(text.substr(at), name); });
  return found == names.end() ? nullptr : &*found;
}

}  // namespace

absl::Status in_options(const absl::Status& refusal, const v1::Settings& given) {
  const std::vector<Name> names = names_for(given);
  const absl::string_view text = refusal.message();
  std::string words;
  bool first_is_option = false;
  for (size_t at = 0; at < text.size();) {
    const Name* name = name_at(names, text, at);
    if (at == 0) first_is_option = name != nullptr && absl::StartsWith(name->option, "--");
    absl::StrAppend(&words, name == nullptr ? text.substr(at, 1) : absl::string_view(name->option));
    at += name == nullptr ? 1 : name->field.size();
  }
  if (absl::IsInvalidArgument(refusal) && first_is_option) return usage_error(words);
  return of_server(reworded(refusal, words));
}

absl::Status of_server(const absl::Status& status) {
  const bool about_frame = absl::IsInvalidArgument(status) || absl::IsResourceExhausted(status);
  return failure_of(about_frame ? FailureKind::kInput : FailureKind::kServer, status);
}

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
