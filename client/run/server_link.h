// The server of a run, and what it refuses in the words of the command line.
#pragma once

#include <atomic>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/connection.h"
#include "client/run/embedded_server.h"
#include "client/run/options.h"
#include "client/session.h"

namespace candela {

// A server's refusals in the words of the command line.

// A refusal names fields of the contract: "exposure.metering.spot begins at x 900 ...". Returns it with the
// options in their place: "--spot begins at x 900 ...". If it begins with a field, the option's value is
// wrong and the result is a usage error. `given` holds the settings that the user gave. Other errors, and
// names that no option sets, stay as they are, and get their kind from of_server().
absl::Status in_options(const absl::Status& refusal, const v1::Settings& given);

// Gives what a call or a session ended with its kind (client/base/failure.h), unless it has one: kInput if
// the server refuses what it was sent (INVALID_ARGUMENT) or could never hold it (RESOURCE_EXHAUSTED), else
// kServer.
absl::Status of_server(const absl::Status& status);

class RunEvents;

// The server that a command uses: a running one, or the built-in one, which starts in this process. Errors of
// its calls have a kind (client/base/failure.h).
//
// Used by one thread.
class ServerLink {
 public:
  // Starts the built-in server on another thread if the choice names
  // no server, so that files can be read meanwhile. `events`, which must outlive this, gets a note of a wait
  // for a server.
  ServerLink(const ServerChoice& choice, RunEvents& events);
  ~ServerLink() { close(); }
  ServerLink(const ServerLink&) = delete;
  ServerLink& operator=(const ServerLink&) = delete;

  // Waits until the built-in server has started. The pointer is valid
  // until close(). A malformed address is a usage error.
  absl::StatusOr<const Connection*> connection();

  // Makes `one` call: to the first server of the choice, and to the next ones or later again as retry() does
  // within the choice's --resume. Any thread may call it after connection() has succeeded.
  absl::Status call(absl::Time deadline, absl::FunctionRef<absl::Status(const Connection&)> one) const;

  // Opens a session on that server, or on one of the other servers of the choice. Ignores `options.servers`.
  // Several sessions may be open at once. All of them must end before close().
  absl::StatusOr<Session> open_session(const SessionOptions& options);

  // Asks the server for its description. Waits as connection() does, then up to 10 s for the answer. Asks the
  // other servers of the choice if the first does not answer.
  absl::StatusOr<v1::GetServerInfoResponse> info();

  // The limits of the server. Asks a running server; does not wait
  // for the built-in one, because its limits are known.
  absl::StatusOr<v1::Limits> limits();

  // A usage error if the server does not know the tier. "" is the default tier and always known.
  absl::Status check_tier(const std::string& tier);

  // The start-up time of the built-in server; 0 for a running server.
  double start_ms() const { return start_ms_; }

  // Stops the built-in server and frees its memory.
  void close();

 private:
  using Started = absl::StatusOr<std::unique_ptr<EmbeddedServer>>;

  // Tells the user once that the command waits for `server`.
  void tell_of_wait(const std::string& server, const absl::Status& why) const;

  // As open_session(), but the error is the session's own.
  absl::StatusOr<Session> open_one(const SessionOptions& session);

  // The addresses of the running servers to use.
  std::vector<std::string> addresses() const;

  const ServerChoice choice_;
  RunEvents& events_;
  mutable std::atomic<bool> told_ = false;  // the user was told of a wait
  std::future<Started> starting_;
  std::unique_ptr<EmbeddedServer> server_;
  std::vector<Connection> connections_;  // to the first server, then to the others of the choice
  double start_ms_ = 0;
};

}  // namespace candela
