// The client's side of the wire: one server, asked to render frames.
#pragma once

#include <grpcpp/channel.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/render_result.h"
#include "client/security.h"

namespace candela {

// A frame to send. Rows from top to bottom, tight; not owned, alive until `on_sent` or until render()
// returns.
struct FrameView {
  uint32_t width = 0;   // pixels
  uint32_t height = 0;  // pixels
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;
  std::span<const std::byte> pixels;
  uint64_t sequence = 0;  // comes back in the result's header
  std::optional<v1::ExposureState> previous =
      std::nullopt;  // to adapt from; none: the frame takes its target
  std::function<void()> on_sent =
      nullptr;             // called once all of `pixels` was copied out, before the result comes
  bool verify = false;     // have the image held against the reference; takes the server seconds
  bool error_map = false;  // have a map of its error, too; only with `verify`
};

// Any thread, several calls at once. Movable. Every failure is one line for the user; the codes are the
// server's own, see render.proto, and UNAVAILABLE for a server that cannot be reached.
class Connection {
 public:
  // `address` is "HOST:PORT" or "unix:PATH". Does not connect yet: INVALID_ARGUMENT for an address of
  // another shape and for `security` that cannot be used, nothing else.
  static absl::StatusOr<Connection> open(const std::string& address, const ClientSecurity& security = {});

  // To a server in this process. `channel` must not outlive that server.
  explicit Connection(std::shared_ptr<grpc::Channel> channel);

  // Sends the frame in bands and collects the image. Holds the image once and, of the frame, one band.
  // A server that refuses the frame by its header is heard before the bands are sent. UNIMPLEMENTED by one
  // that does not verify where it was asked to.
  absl::StatusOr<RenderResult> render(const v1::Settings& settings, const FrameView& frame,
                                      absl::Time deadline = absl::InfiniteFuture()) const;

  // Sends the frame in bands and has it metered; no image is made. FrameView's `on_sent`, `verify` and
  // `error_map` are not looked at.
  absl::StatusOr<v1::MeterResponse> meter(const v1::Settings& settings, const FrameView& frame,
                                          absl::Time deadline = absl::InfiniteFuture()) const;

  absl::StatusOr<v1::GetServerInfoResponse> server_info(absl::Time deadline = absl::InfiniteFuture()) const;

  // OK when the server says SERVING; UNAVAILABLE when it says anything else or cannot be reached.
  absl::Status health(absl::Time deadline = absl::InfiniteFuture()) const;

  // As it was given to open(); "this process" for a channel.
  const std::string& address() const { return peer_.address; }
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  Connection(std::shared_ptr<grpc::Channel> channel, Peer peer);

  std::shared_ptr<grpc::Channel> channel_;
  Peer peer_;
};

}  // namespace candela
