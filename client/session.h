// A session with a render server: frames go in, and their results come back in the same order.
//
// Exposure adapts from frame to frame over media time, as in a film. If the server is lost, the session
// resumes on the next one and sends the unfinished frames again. Every frame still gets exactly one result,
// with the same bits.
//
//   candela::SessionOptions options;
//   options.servers = {"render1:50051", "render2:50051"};
//   absl::StatusOr<candela::Session> session = candela::Session::open(options);
//   if (!session.ok()) return session.status();
//   std::thread producer([&] {
//     while (std::optional<candela::SessionFrame> frame = next_frame()) {
//       if (!session->submit(*std::move(frame)).ok()) break;  // next_result() returns the reason
//     }
//     session->finish();
//   });
//   absl::StatusOr<std::optional<candela::FrameResult>> result;
//   while ((result = session->next_result()).ok() && *result) show(**result);
//   producer.join();
#pragma once

#include <grpcpp/channel.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/panorama.h"
#include "client/render_result.h"
#include "client/security.h"

namespace candela {

// How pixels and images travel. Images are the same bits.
enum class Transport {
  // Memory where the server's address is unix:PATH and it offers that (docs/transport.md), else in bands,
  // which are compressed on a slow link.
  kAuto,
  kGrpc,    // in bands as they are
  kZstd,    // in bands, compressed if the server takes that
  kMemory,  // as kAuto, but open() fails unless the first server offers it
};

struct SessionOptions {
  // At least one address, "HOST:PORT" or "unix:PATH". The session opens on the first server that accepts it.
  // When it loses that server, it tries the next one in the list, and after the last one the first again. To
  // resume, all servers need the same resume keys.
  std::vector<std::string> servers;
  ClientSecurity security;  // for all servers
  Transport transport = Transport::kAuto;
  std::string name;        // see StreamOpen.session; empty: a random name
  v1::Settings settings;   // from the first frame on
  uint32_t lookahead = 0;  // frames that auto exposure looks ahead, 0 .. 16; results are delayed by as many
  double cut_threshold_ev = 0;               // EV, see StreamOpen; 0: only frames marked as cuts are cuts
  v1::Encoding encoding = v1::ENCODING_RAW;  // NONE: frames are metered and exposed, and no image is made
  // Continues the exposure of another session after the frame that this is the state of. Frames must have
  // later numbers, and times that are not earlier.
  std::optional<v1::SessionState> state = std::nullopt;
  bool return_state = false;  // every result's header holds the state after its frame
  uint32_t jpeg_quality = 0;  // 1 .. 100; 0: the server's default
  // The longest time without results after a loss; then the session ends. Also how long open() waits for a
  // server that was reached but is full, starting or draining. If a server says when to come back
  // (google.rpc.RetryInfo), the session does not call it earlier.
  absl::Duration resume_limit = absl::Seconds(30);
  // Called during open(), on the session's own thread, before each wait for such a server: its address and
  // why it did not open the session.
  std::function<void(const std::string& server, const absl::Status& why)> on_open_wait = nullptr;
  // A server that owes a result or has data to read, but neither sends nor reads for this long, counts as
  // hanging, and the session leaves it. Make this much longer than frames may wait for their turn or for
  // memory.
  absl::Duration silence_limit = absl::Minutes(5);
  // After this much silence the client pings the server. Without an answer in the same time again, the
  // connection is lost. At least 1 s. Channels passed to open() keep their own settings instead.
  absl::Duration ping_interval = absl::Seconds(10);
};

// A frame to send.
struct SessionFrame {
  uint32_t width = 0;   // pixels
  uint32_t height = 0;  // pixels
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;
  // Rows from top to bottom without padding. They must not change while the session holds `owner`.
  std::span<const std::byte> pixels = {};
  // Keeps `pixels` alive. The session holds it until the frame has its result, because the frame may have to
  // be sent again, and gRPC may hold it a little longer. Without an owner `pixels` must live as long as gRPC
  // does.
  std::shared_ptr<const void> owner = nullptr;
  uint64_t sequence = 0;      // greater than the previous frame's; comes back with the result
  int64_t media_time_ns = 0;  // presentation time, 0 .. 2^62 ns; not before the previous frame's
  bool cut = false;           // a new scene begins here: exposure jumps to this frame's target
  // The factor to render the frame with, 2^-40 .. 2^40, instead of the one that metering decides.
  std::optional<double> exposure = std::nullopt;
  // The longest time from the server's reading the frame's header to rendering it. If it passes, the result
  // is DEADLINE_EXCEEDED.
  absl::Duration timeout = absl::InfiniteDuration();
  // Instead of pixels: the server renders this view. `format` and `owner` are not used, and `pixels` must be
  // empty.
  std::optional<v1::View> view = std::nullopt;
  // The panorama of the view's environment. The session puts it on a server that does not have it, and goes
  // on. Without it such a server ends the session with NOT_FOUND.
  std::shared_ptr<const Panorama> panorama = nullptr;
};

// Memory for the pixels of a frame. Fill it, then submit them with their owner; frames in other memory are
// copied if it is shared.
struct FrameArea {
  std::span<std::byte> pixels;  // empty: this process lacks the memory
  std::shared_ptr<const void> owner;
};

// The result of one frame.
struct FrameResult {
  uint64_t sequence = 0;
  // INVALID_ARGUMENT or DEADLINE_EXCEEDED if this frame failed. The session continues.
  absl::Status status;
  // Set if status is OK; only its header if the encoding is NONE. It may lie in the session's shared memory:
  // an image that the caller still holds leaves less room for later ones, which then come in bands.
  RenderResult image;
  absl::Duration latency;  // from submit() to the arrival of the whole result
};

struct SessionStats {
  std::string server;                   // the current or the last server; "this process" for a channel
  uint32_t window = 0;                  // submit() waits while this many frames have no result
  uint64_t submitted = 0;               // frames
  uint64_t answered = 0;                // frames
  uint64_t resumes = 0;                 // how often the session resumed on a new connection
  uint64_t sent_again = 0;              // frames sent a second time after a resume
  absl::Duration time_without_results;  // total, from each loss to the next result or until now
  absl::Status last_loss;               // why the last connection was lost; OK if none was
  bool shares_memory = false;           // with the current server
  bool mixed_bits = false;              // its servers differ in DeviceInfo.bits, so images may differ in bits
};

// Any thread may call the members; usually one thread submits while another takes results. The session has a
// separate thread that talks to the server. Movable.
class Session {
 public:
  // Waits until a server has opened the session. Returns INVALID_ARGUMENT for a malformed address or unusable
  // security files. If no server can be reached, returns the error of the last one at once. Asks servers that
  // were reached but are full, starting or draining again, for options.resume_limit at most; then
  // UNAVAILABLE.
  static absl::StatusOr<Session> open(const SessionOptions& options);

  // The same through `channels` instead of options.servers. The channel of a server in this process must not
  // outlive that server.
  static absl::StatusOr<Session> open(std::vector<std::shared_ptr<grpc::Channel>> channels,
                                      const SessionOptions& options);

  // Cancels the session. No other thread may be in a member.
  ~Session();
  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;

  // Queues the frame for sending. Waits while stats().window frames have no result, or while as many results
  // wait for next_result(). So a thread that calls both must check ready() first. Returns INVALID_ARGUMENT
  // for a malformed frame or one out of order; the session continues without it. Returns FAILED_PRECONDITION
  // after finish(), and the session's final status once it has failed.
  absl::Status submit(SessionFrame frame);

  // Memory for a frame of this size: shared with the server if it can be, and some of it is free, or else
  // this process's own. Does not wait for results.
  FrameArea area(uint32_t width, uint32_t height, v1::PixelFormat format);

  // Whether submit() would return without waiting.
  bool ready() const;

  // Replaces all settings from frame `from_sequence` on, which must not have been submitted yet. Returns
  // INVALID_ARGUMENT if the number is too low, and FAILED_PRECONDITION if 16 changes are already waiting for
  // their frame. Otherwise fails like submit().
  absl::Status change_settings(uint64_t from_sequence, const v1::Settings& settings);

  // Says that no more frames follow. The submitted ones still get their results.
  void finish();

  // Ends the session at once with CANCELLED. Threads that wait in a member return.
  void cancel();

  // Waits for the next frame's result. Results come in the order of the frames, one for each. Returns nullopt
  // when finish() was called and every frame has its result. An error ends the session and comes after all
  // earlier results: the server's refusal (see Stream in render.proto), UNAVAILABLE if no server resumed the
  // session within the resume limit (a session that owes nothing is resumed when it has a frame to send), or
  // UNIMPLEMENTED if the server is too old for states or for the exposures of frames.
  absl::StatusOr<std::optional<FrameResult>> next_result();

  SessionStats stats() const;
  const std::string& name() const;

 private:
  class Core;
  explicit Session(std::unique_ptr<Core> core);
  std::unique_ptr<Core> core_;
};

}  // namespace candela
