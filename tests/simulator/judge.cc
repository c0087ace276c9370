#include "tests/simulator/judge.h"

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"

namespace candela::testing {
namespace {

// docs/robustness.md: what a session may end with, and by what fault.
bool may_end(const SimulatedClient& client, const absl::Status& end, const Circumstances& were) {
  const auto says = [&end](const char* words) { return absl::StrContains(end.message(), words); };
  switch (end.code()) {
    case absl::StatusCode::kCancelled:
      return client.cancelled();
    case absl::StatusCode::kUnavailable: {
      if (were.impatient && says("no server opens the session")) return true;
      if (were.impatient && says("no server has taken the session on")) {
        return were.has("set_clock") || client.waited() > 0.98 * client.film().options.resume_limit;
      }
      // Not one of the servers was reached at the first open.
      return !client.was_open() && (says("failed to connect") || says("it hangs"));
    }
    case absl::StatusCode::kFailedPrecondition:
      return (were.has("expired_token") && says("expired")) ||
             (were.has("duplicate_resume") && says("was resumed after this token"));
    case absl::StatusCode::kAborted:
      return were.has("duplicate_resume") && says("another call resumed this session");
    case absl::StatusCode::kAlreadyExists:
      return were.has("duplicate_name") && says("is open on another call");
    default:
      return false;
  }
}

}  // namespace

absl::Status judge(const SimulatedClient& client, const Circumstances& were) {
  if (!client.mistake().ok()) return client.mistake();
  // A server that lacks a panorama ends the call.
  if (!were.disturbed && client.stats().resumes > client.puts()) {
    return absl::InternalError("it resumes, and nothing has happened");
  }
  if (!client.end()) return absl::OkStatus();
  const absl::Status& end = *client.end();
  if (!end.ok()) {
    return may_end(client, end, were) ? absl::OkStatus()
                                      : absl::InternalError("it ends with " + end.ToString());
  }
  if (client.results() == client.film().frames.size()) return absl::OkStatus();
  return absl::InternalError(absl::StrFormat("the session ends with OK and %d of %d results",
                                             client.results(), client.film().frames.size()));
}

}  // namespace candela::testing
