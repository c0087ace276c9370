#include "client/session.h"

#include <algorithm>
#include <chrono>
#include <deque>
#include <random>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "client/call/duplex_call.h"
#include "client/call/retry_info.h"
#include "client/call/stream_reader.h"
#include "client/call/wire.h"
#include "client/session_log.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/message_wire.h"

namespace candela {
namespace {

// A server that says nothing to an open for so long is passed over.
constexpr absl::Duration kOpenLimit = absl::Seconds(10);

// Between rounds over all servers: doubled from round to round.
constexpr absl::Duration kFirstPause = absl::Milliseconds(50);
constexpr absl::Duration kLongestPause = absl::Seconds(1);

std::string random_name() {
  std::random_device random;
  return absl::StrFormat("session-%08x%08x", random(), random());
}

struct Server {
  std::shared_ptr<grpc::Channel> channel;
  Peer peer;
};

// How a call ended.
struct CallEnd {
  absl::Status status;  // OK: the session is over, with every frame answered
  bool resume = false;  // another call may go on
  // How long that server wants to be left alone.
  absl::Duration retry_delay = absl::ZeroDuration();
};

// Whether the transport or a server that stops is the reason, and not what this session asked for.
bool may_resume(const grpc::Status& status, bool resuming) {
  switch (status.error_code()) {
    case grpc::UNAVAILABLE:
    case grpc::CANCELLED:
      return true;
    case grpc::ALREADY_EXISTS:
      // The server has not noticed yet that it lost us.
      return resuming;
    case grpc::INTERNAL:
      return absl::StrContains(status.error_message(), "RST_STREAM");
    case grpc::UNKNOWN:
      // gRPC's own words: the call ended without the server's. The second ones where a proxy ended it.
      return absl::StrContains(status.error_message(), "Stream removed") ||
             absl::StrContains(status.error_message(), "No status received");
    default:
      return false;
  }
}

// The rows of `frame` from `row` on that go into one band, referred to: gRPC may hold on to a message after
// its call has ended, so the slice holds on to the frame.
grpc::Slice band_slice(const std::shared_ptr<const SessionFrame>& frame, uint64_t row) {
  const uint64_t row_bytes = frame->width * bytes_per_pixel(frame->format);
  const uint64_t bytes = std::min<uint64_t>(rows_of_band(row_bytes), frame->height - row) * row_bytes;
  const auto let_go = [](void* owner) { delete static_cast<std::shared_ptr<const SessionFrame>*>(owner); };
  return grpc::Slice(const_cast<std::byte*>(frame->pixels.data() + row * row_bytes), bytes, let_go,
                     new std::shared_ptr<const SessionFrame>(frame));
}

v1::FrameHeader header_of(const SessionFrame& frame) {
  v1::FrameHeader header;
  header.set_sequence(frame.sequence);
  header.set_width(frame.width);
  header.set_height(frame.height);
  header.set_format(frame.format);
  header.set_total_bytes(frame.pixels.size());
  header.set_media_time_ns(frame.media_time_ns);
  header.set_cut(frame.cut);
  if (frame.timeout != absl::InfiniteDuration()) {
    header.set_timeout_ms(
        static_cast<uint32_t>(std::clamp<int64_t>(absl::ToInt64Milliseconds(frame.timeout), 1, UINT32_MAX)));
  }
  return header;
}

}  // namespace

class Session::Core {
 public:
  static absl::StatusOr<Session> open(std::vector<Server> servers, const SessionOptions& options) {
    auto core = std::make_unique<Core>(std::move(servers), options);
    if (absl::Status status = core->wait_until_open(); !status.ok()) return status;
    return Session(std::move(core));
  }

  Core(std::vector<Server> servers, const SessionOptions& options)
      : options_(options),
        name_(options.name.empty() ? random_name() : options.name),
        servers_(std::move(servers)),
        not_before_(servers_.size(), absl::InfinitePast()),
        log_(options.settings),
        thread_([this] { drive(); }) {}

  ~Core() {
    cancel();
    thread_.join();
  }

  void cancel() {
    const absl::MutexLock lock(&mutex_);
    cancelled_ = true;
    wake();
  }

  absl::Status wait_until_open() {
    const absl::MutexLock lock(&mutex_);
    const auto decided = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return was_open_ || ended_; };
    mutex_.Await(absl::Condition(&decided));
    return was_open_ ? absl::OkStatus() : end_;
  }

  absl::Status submit(SessionFrame frame) {
    const absl::MutexLock lock(&mutex_);
    const auto may = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return may_submit(); };
    mutex_.Await(absl::Condition(&may));
    if (absl::Status status = still_taking(); !status.ok()) return status;
    if (absl::Status status = log_.add(std::move(frame), absl::Now()); !status.ok()) return status;
    ++submitted_;
    wake();
    return absl::OkStatus();
  }

  bool ready() const {
    const absl::MutexLock lock(&mutex_);
    return may_submit();
  }

  absl::Status change_settings(uint64_t from_sequence, const v1::Settings& settings) {
    const absl::MutexLock lock(&mutex_);
    if (absl::Status status = still_taking(); !status.ok()) return status;
    if (absl::Status status = log_.change(from_sequence, settings); !status.ok()) return status;
    wake();
    return absl::OkStatus();
  }

  void finish() {
    const absl::MutexLock lock(&mutex_);
    finished_ = true;
    wake();
  }

  absl::StatusOr<std::optional<FrameResult>> next_result() {
    const absl::MutexLock lock(&mutex_);
    const auto any = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return !results_.empty() || ended_; };
    mutex_.Await(absl::Condition(&any));
    if (results_.empty()) {
      if (!end_.ok()) return end_;
      return std::nullopt;
    }
    std::optional<FrameResult> result = std::move(results_.front());
    results_.pop_front();
    return result;
  }

  SessionStats stats() const {
    const absl::MutexLock lock(&mutex_);
    SessionStats stats = stats_;
    stats.server = servers_[at_].peer.address;
    stats.window = window_;
    stats.submitted = submitted_;
    stats.answered = submitted_ - log_.unanswered();
    if (lost_) stats.time_without_results += absl::Now() - *lost_;
    return stats;
  }

  const std::string& name() const { return name_; }

 private:
  // What the driving thread knows of the call that it has.
  struct Call {
    Call(const Server& server, const std::string& session)
        : peer(server.peer),
          duplex(server.channel, "/candela.v1.RenderService/Stream", {{"x-session-id", session}}) {}

    const Peer& peer;
    DuplexCall duplex;
    StreamReader reader;
    bool asked = false;                                     // the open message is out
    bool open = false;                                      // the server has the session
    bool leaving = false;                                   // the server goes away: nothing more is sent
    bool closed = false;                                    // half-closed
    std::shared_ptr<const SessionFrame> sending = nullptr;  // its bands are going out
    uint64_t row = 0;                                       // of the next one
    int64_t owed = 0;                                       // frames that were sent whole and have no result
    bool answered = false;                                  // a result came
    absl::Time last_progress;                               // a message came, or a write began or ended
  };

  bool may_submit() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return ended_ || finished_ || (log_.unanswered() < window_ && results_.size() < window_);
  }

  absl::Status still_taking() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (ended_ && !end_.ok()) return end_;
    if (!finished_) return absl::OkStatus();
    return absl::FailedPreconditionError("the session was finished; open another one for more frames");
  }

  void wake() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (call_ != nullptr) call_->wake();
  }

  // The thread: one call after the other, until the session ends.
  void drive() {
    size_t attempts = 0;  // without a result between them
    while (true) {
      const CallEnd end = run_call(attempts);
      const absl::MutexLock lock(&mutex_);
      if (cancelled_) return end_session(absl::CancelledError("the session was cancelled"));
      if (end.status.ok() || !end.resume) return end_session(end.status);
      ++attempts;
      not_before_[at_] = absl::Now() + end.retry_delay;
      if (!was_open_) {
        if (attempts == servers_.size()) return end_session(end.status);
      } else {
        stats_.last_loss = end.status;
        if (!lost_) lost_ = absl::Now();
        if (!pause_before_attempt(attempts)) {
          if (cancelled_) return end_session(absl::CancelledError("the session was cancelled"));
          return end_session(absl::UnavailableError(
              absl::StrFormat("no server has taken the session on for %s: %s",
                              absl::FormatDuration(options_.resume_limit), end.status.message())));
        }
      }
      at_ = (at_ + 1) % servers_.size();
    }
  }

  // False when the session is not to go on.
  bool pause_before_attempt(size_t attempts) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const absl::Time limit = *lost_ + options_.resume_limit;
    absl::Time until = absl::Now();
    // The first round over all servers is without pauses; where there is one alone, its first try is.
    if (attempts > 1 && attempts % servers_.size() == 0) {
      const size_t rounds = std::min<size_t>(attempts / servers_.size() - 1, 10);
      until += std::min(kLongestPause, kFirstPause * (int64_t{1} << rounds));
    }
    until = std::max(until, not_before_[(at_ + 1) % servers_.size()]);
    const auto cancelled = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return cancelled_; };
    mutex_.AwaitWithDeadline(absl::Condition(&cancelled), std::min(until, limit));
    return !cancelled_ && absl::Now() < limit;
  }

  void end_session(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    ended_ = true;
    end_ = status;
    if (lost_) stats_.time_without_results += absl::Now() - *lost_;
    lost_.reset();
  }

  CallEnd run_call(size_t& attempts) {
    v1::StreamRequest open;
    Call call(servers_[at_], name_);
    {
      const absl::MutexLock lock(&mutex_);
      if (cancelled_) return {absl::CancelledError()};
      open = open_message();
      sent_before_ = log_.rewind();
      call_ = &call.duplex;
    }
    const absl::Time open_by = absl::Now() + kOpenLimit;
    CallEnd own;  // why this side ended it
    while (true) {
      if (own.status.ok() && call.duplex.can_write()) {
        send_next(call, open);
        if (call.duplex.writing()) call.last_progress = absl::Now();
      }
      absl::Time until = call.open ? silent_until(call) : open_by;
      if (!own.status.ok()) until = absl::InfiniteFuture();
      const DuplexCall::Event event = call.duplex.wait(until);
      if (event == DuplexCall::Event::kEnded) break;
      if (!own.status.ok()) continue;
      if (event == DuplexCall::Event::kMessage || event == DuplexCall::Event::kWritable) {
        call.last_progress = absl::Now();
      }
      if (event == DuplexCall::Event::kTimeout) {
        own = {absl::UnavailableError(
                   absl::StrFormat("no answer from %s within %s: it hangs%s", call.peer.address,
                                   absl::FormatDuration(call.open ? options_.silence_limit : kOpenLimit),
                                   call.open ? "" : " or is not a candelad")),
               true};
      } else if (event == DuplexCall::Event::kMessage) {
        own.status = take_message(call, attempts);
      } else if (event == DuplexCall::Event::kWoken) {
        const absl::MutexLock lock(&mutex_);
        if (cancelled_) own.status = absl::CancelledError();
      }
      if (!own.status.ok()) call.duplex.cancel();
    }
    {
      const absl::MutexLock lock(&mutex_);
      call_ = nullptr;
    }
    return own.status.ok() ? how_it_ended(call) : own;
  }

  // When a server that goes on saying nothing hangs. Look-ahead holds as many frames back as it looks ahead,
  // until the half-close.
  absl::Time silent_until(const Call& call) const {
    const int64_t held_back = call.closed ? 0 : options_.lookahead;
    const bool due = call.owed > held_back || call.duplex.writing();
    return due ? call.last_progress + options_.silence_limit : absl::InfiniteFuture();
  }

  v1::StreamRequest open_message() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    v1::StreamRequest request;
    v1::StreamOpen& open = *request.mutable_open();
    open.set_session(name_);
    *open.mutable_settings() = log_.settings();
    open.set_resume_token(log_.token());
    open.set_lookahead(options_.lookahead);
    open.set_cut_threshold_ev(options_.cut_threshold_ev);
    open.set_encoding(options_.encoding);
    open.set_jpeg_quality(options_.jpeg_quality);
    return request;
  }

  // Not under the lock: finding out why TLS failed may take seconds.
  CallEnd how_it_ended(const Call& call) const ABSL_LOCKS_EXCLUDED(mutex_) {
    const grpc::Status& status = call.duplex.status();
    bool resumable = false;
    {
      const absl::MutexLock lock(&mutex_);
      if (call.closed && finished_ && log_.unanswered() == 0 && (status.ok() || may_resume(status, true))) {
        return {absl::OkStatus()};
      }
      // The session's own call before, whose open came late, may have taken it over.
      const bool by_itself = status.error_code() == grpc::ABORTED && was_open_ && !call.answered;
      resumable = by_itself || may_resume(status, was_open_);
    }
    if (status.ok()) {
      // A proxy, too, may end a call like that when it cuts it short.
      const char* how = call.leaving ? " went away" : " ended before every frame had its result";
      return {absl::UnavailableError(call.peer.address + how), true};
    }
    return {from_grpc(status, call.peer, call.duplex.connected()), resumable, retry_delay(status)};
  }

  // Starts the next write, if there is anything to send.
  void send_next(Call& call, const v1::StreamRequest& open) {
    if (!call.asked) {
      call.asked = true;
      return call.duplex.write(v1::pack(open));
    }
    if (!call.open || call.leaving || call.closed) return;
    if (call.sending != nullptr) return send_band(call);
    v1::StreamRequest request;
    {
      const absl::MutexLock lock(&mutex_);
      const SessionStep* step = log_.next();
      if (step == nullptr && !finished_) return;
      if (step == nullptr) {
        call.closed = true;
      } else if (step->frame == nullptr) {
        request.mutable_change()->set_from_sequence(step->from_sequence);
        *request.mutable_change()->mutable_settings() = step->settings;
      } else {
        *request.mutable_frame() = header_of(*step->frame);
        call.sending = step->frame;
        call.row = 0;
      }
    }
    if (call.closed) return call.duplex.half_close();
    call.duplex.write(v1::pack(request));
  }

  static void send_band(Call& call) {
    const uint64_t rows = rows_of_band(call.sending->width * bytes_per_pixel(call.sending->format));
    call.duplex.write(v1::make_band(v1::kStreamFrameBand, static_cast<uint32_t>(call.row),
                                    band_slice(call.sending, call.row)));
    call.row += rows;
    if (call.row < call.sending->height) return;
    call.sending.reset();
    ++call.owed;
  }

  absl::Status take_message(Call& call, size_t& attempts) {
    std::shared_ptr<const SessionFrame> due;
    {
      const absl::MutexLock lock(&mutex_);
      const SessionStep* step = log_.due();
      if (step != nullptr) due = step->frame;
    }
    absl::StatusOr<StreamEvent> event = call.reader.read(call.duplex.message(), due.get());
    if (!event.ok()) return event.status();
    if (const auto* opened = std::get_if<v1::StreamOpened>(&*event)) {
      call.open = true;
      take_open(*opened, attempts);
    }
    if (std::holds_alternative<v1::GoAway>(*event)) call.leaving = true;
    if (auto* answer = std::get_if<FrameAnswer>(&*event)) {
      take_answer(std::move(*answer));
      call.answered = true;
      --call.owed;
      attempts = 0;
    }
    return absl::OkStatus();
  }

  void take_open(const v1::StreamOpened& opened, size_t& attempts) {
    const absl::MutexLock lock(&mutex_);
    window_ = std::max<uint32_t>(1, opened.max_frames_in_flight()) + options_.lookahead;
    if (was_open_) ++stats_.resumes;
    if (was_open_) stats_.sent_again += sent_before_;
    was_open_ = true;
    if (log_.unanswered() == 0) {
      found_again();
      attempts = 0;
    }
  }

  void take_answer(FrameAnswer answer) {
    const absl::MutexLock lock(&mutex_);
    const SessionStep& step = *log_.due();
    results_.push_back({step.frame->sequence, std::move(answer.status), std::move(answer.image),
                        absl::Now() - step.submitted});
    log_.answered(answer.token);
    found_again();
  }

  void found_again() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!lost_) return;
    stats_.time_without_results += absl::Now() - *lost_;
    lost_.reset();
  }

  const SessionOptions options_;
  const std::string name_;
  const std::vector<Server> servers_;
  std::vector<absl::Time> not_before_;  // when each wants to be asked again; the thread's

  mutable absl::Mutex mutex_;
  size_t at_ = 0;  // the server in use; written by the thread, under the mutex
  SessionLog log_ ABSL_GUARDED_BY(mutex_);
  std::deque<FrameResult> results_ ABSL_GUARDED_BY(mutex_);  // not taken yet
  uint32_t window_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t submitted_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t sent_before_ ABSL_GUARDED_BY(mutex_) = 0;  // of the log's frames, on earlier calls
  bool was_open_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status end_ ABSL_GUARDED_BY(mutex_);
  std::optional<absl::Time> lost_ ABSL_GUARDED_BY(mutex_);  // since then there were no results
  SessionStats stats_ ABSL_GUARDED_BY(mutex_);
  DuplexCall* call_ ABSL_GUARDED_BY(mutex_) = nullptr;
  std::thread thread_;  // last, so that it finds the rest made
};

absl::StatusOr<Session> Session::open(const SessionOptions& options) {
  if (options.servers.empty()) {
    return absl::InvalidArgumentError("a session needs the address of at least one server");
  }
  std::vector<Server> servers;
  for (const std::string& address : options.servers) {
    Peer peer{address, options.security};
    absl::StatusOr<std::shared_ptr<grpc::Channel>> channel =
        open_session_channel(peer, options.ping_interval);
    if (!channel.ok()) return channel.status();
    servers.push_back({*std::move(channel), std::move(peer)});
  }
  return Core::open(std::move(servers), options);
}

absl::StatusOr<Session> Session::open(std::vector<std::shared_ptr<grpc::Channel>> channels,
                                      const SessionOptions& options) {
  if (channels.empty()) return absl::InvalidArgumentError("a session needs at least one channel");
  std::vector<Server> servers;
  for (std::shared_ptr<grpc::Channel>& channel : channels) {
    servers.push_back({std::move(channel), Peer{"this process"}});
  }
  return Core::open(std::move(servers), options);
}

Session::Session(std::unique_ptr<Core> core) : core_(std::move(core)) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;

absl::Status Session::submit(SessionFrame frame) { return core_->submit(std::move(frame)); }
bool Session::ready() const { return core_->ready(); }
absl::Status Session::change_settings(uint64_t from_sequence, const v1::Settings& settings) {
  return core_->change_settings(from_sequence, settings);
}
void Session::finish() { core_->finish(); }
void Session::cancel() { core_->cancel(); }
absl::StatusOr<std::optional<FrameResult>> Session::next_result() { return core_->next_result(); }
SessionStats Session::stats() const { return core_->stats(); }
const std::string& Session::name() const { return core_->name(); }

}  // namespace candela
