// A session: frames go in, results come back in their order, with exposure that adapts over media time, and a
// server that dies on the way costs neither.
#pragma once

#include <grpcpp/channel.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/render_result.h"
#include "client/security.h"

namespace candela {

struct SessionOptions {
  // "HOST:PORT" or "unix:PATH", at least one. The session starts on the first that takes it and goes on
  // with the next one, round and round, when it loses it. All of them need the same keys for that.
  std::vector<std::string> servers;
  ClientSecurity security;  // with all of them
  std::string name;         // see StreamOpen.session; empty: a random one
  v1::Settings settings;    // from the first frame on
  uint32_t lookahead = 0;   // frames, 0 .. 16: exposure looks so far ahead, and results come so much later
  double cut_threshold_ev = 0;  // see StreamOpen; 0: cuts are where frames say so
  v1::Encoding encoding = v1::ENCODING_RAW;
  uint32_t jpeg_quality = 0;  // 1 .. 100; 0 is the server's default
  // How long the session may be without a server, from losing it to the next result. A server that says when
  // to come back (google.rpc.RetryInfo) is not asked before, and so not again where that is later than this.
  absl::Duration resume_limit = absl::Seconds(30);
  // A server that neither sends nor reads for so long while a result or a read is due hangs, and the session
  // goes on without it. Frames honestly wait, for their turn and for memory: this is to be far longer than
  // that.
  absl::Duration silence_limit = absl::Minutes(5);
  // A connection from which nothing came for so long is asked for a sign of life, and is lost when there is
  // none for as long again; 1 s or more. Not of channels, which come with settings of their own.
  absl::Duration ping_interval = absl::Seconds(10);
};

// A frame to send.
struct SessionFrame {
  uint32_t width = 0;   // pixels
  uint32_t height = 0;  // pixels
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;
  std::span<const std::byte> pixels;  // rows from top to bottom, tight; not changed while `owner` is held
  // Keeps `pixels` alive. It is held until the frame has its result, for it may have to be sent again, and
  // then until gRPC has let go of the last copy it was sent by. None: `pixels` outlives the process's gRPC.
  std::shared_ptr<const void> owner;
  uint64_t sequence = 0;      // above the frame's before; comes back with the result
  int64_t media_time_ns = 0;  // when it is shown, 0 .. 2^62; not before the frame before it
  bool cut = false;           // another scene begins: it takes its target exposure at once
  // Not rendered later than this after the server has its header: its result is then DEADLINE_EXCEEDED.
  absl::Duration timeout = absl::InfiniteDuration();
};

// What became of a frame.
struct FrameResult {
  uint64_t sequence = 0;
  absl::Status status;     // the frame's own: INVALID_ARGUMENT or DEADLINE_EXCEEDED, and the session goes on
  RenderResult image;      // where status is OK
  absl::Duration latency;  // from when submit() took it until all of the image was here
};

struct SessionStats {
  std::string server;       // the one that has the session or had it last; "this process" for a channel
  uint32_t window = 0;      // frames without a result at which submit() waits
  uint64_t submitted = 0;   // frames
  uint64_t answered = 0;    // frames
  uint64_t resumes = 0;     // how often the session went on on another connection
  uint64_t sent_again = 0;  // frames that a resumed session had to send once more
  absl::Duration time_without_results;  // from each loss to the next result, or until now
  absl::Status last_loss;               // why the last connection was lost; OK when none was
};

// Members may be called from any thread; usually one submits while another takes results. A thread of its own
// talks to the server. Movable.
class Session {
 public:
  // Waits until a server has taken the session. INVALID_ARGUMENT for an address of another shape or for
  // security that cannot be used; else what
  // the last server said that could not be reached or refused.
  static absl::StatusOr<Session> open(const SessionOptions& options);

  // The same on servers that `channels` lead to, in place of options.servers. A channel of a server in this
  // process does not outlive it.
  static absl::StatusOr<Session> open(std::vector<std::shared_ptr<grpc::Channel>> channels,
                                      const SessionOptions& options);

  // Cancels what is under way. No other thread may be inside of a member.
  ~Session();
  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;

  // Takes the frame, to be sent as soon as the server reads on. Waits while stats().window frames have no
  // result, or as many results were not taken: a thread that both submits and takes looks at ready() first.
  // INVALID_ARGUMENT for a frame that is none or out of order, and the session goes on. Once the session has
  // ended, the status it ended with; FAILED_PRECONDITION after finish().
  absl::Status submit(SessionFrame frame);

  // Whether submit() would not wait.
  bool ready() const;

  // From the frame `from_sequence` on, which was not submitted yet, all of the settings are these.
  // INVALID_ARGUMENT for a number that is too low, FAILED_PRECONDITION when 16 changes are ahead of the
  // frames already, or as submit().
  absl::Status change_settings(uint64_t from_sequence, const v1::Settings& settings);

  // No more frames come. Those that were submitted still get their results.
  void finish();

  // Ends it at once, with CANCELLED: whoever waits in a member returns.
  void cancel();

  // Waits for the next frame's result, in the order of the frames, each once. None: finish() was called and
  // every frame has its result. A failure is the end of the session, after all results that came before:
  // the server's refusal (see Stream in render.proto), or UNAVAILABLE when no server took the session on
  // within the resume limit. DEADLINE_EXCEEDED for a session that sent nothing for the server's idle timeout.
  absl::StatusOr<std::optional<FrameResult>> next_result();

  SessionStats stats() const;
  const std::string& name() const;

 private:
  class Core;
  explicit Session(std::unique_ptr<Core> core);
  std::unique_ptr<Core> core_;
};

}  // namespace candela
