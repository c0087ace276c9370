// A connection to one render server, for single frames. For a sequence of frames see session.h.
//
//   absl::StatusOr<candela::Connection> server = candela::Connection::open("localhost:50051");
//   if (!server.ok()) return server.status();
//   candela::FrameView frame{.width = 1920, .height = 1080, .pixels = halves};
//   absl::StatusOr<candela::RenderResult> image = server->render(candela::v1::Settings(), frame);
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
#include "client/panorama.h"
#include "client/render_result.h"
#include "client/security.h"

namespace candela {

// A frame to send. It does not own its pixels.
struct FrameView {
  uint32_t width = 0;   // pixels
  uint32_t height = 0;  // pixels
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;
  // Rows from top to bottom without padding. They must live until `on_sent` is called or the call returns.
  std::span<const std::byte> pixels = {};
  uint64_t sequence = 0;  // comes back in the result's header
  // The exposure to adapt from. Without it the frame takes its target exposure.
  std::optional<v1::ExposureState> previous = std::nullopt;
  // The factor to render the frame with, 2^-40 .. 2^40; not with `previous`.
  std::optional<double> exposure = std::nullopt;
  // Called once all of `pixels` is copied, before the result arrives.
  std::function<void()> on_sent = nullptr;
  bool verify = false;     // compare the image with the float64 reference; takes the server seconds
  bool error_map = false;  // also return a map of the error; only with `verify`
  // Instead of pixels: the server renders this view. `format` is not used, and `pixels` must be empty.
  std::optional<v1::View> view = std::nullopt;
};

// Any thread may use it, for several calls at once. Movable. Every error message is one line for the user.
// The codes are the server's, see render.proto, or UNAVAILABLE for a server that cannot be reached or is
// lost. A server that is silent for 10 s is pinged, and is lost if it does not answer within 10 s. A call
// that passes its deadline is DEADLINE_EXCEEDED. No call is repeated; retry() in retry.h does that.
class Connection {
 public:
  // `address` is "HOST:PORT" or "unix:PATH". This does not connect yet. It fails only with INVALID_ARGUMENT,
  // for a malformed address or unusable security files.
  static absl::StatusOr<Connection> open(const std::string& address, const ClientSecurity& security = {});

  // A connection to a server in this process. `channel` must not outlive that server.
  explicit Connection(std::shared_ptr<grpc::Channel> channel);

  // A connection over a channel that leads to `peer`.
  Connection(std::shared_ptr<grpc::Channel> channel, Peer peer);

  // Renders the frame and returns the image. It is sent in bands, and only one band is copied at a time. If
  // the server refuses the frame by its header, no pixels are sent. UNIMPLEMENTED if `verify` or
  // `exposure` is set and the server does not know it.
  absl::StatusOr<RenderResult> render(const v1::Settings& settings, const FrameView& frame,
                                      absl::Time deadline = absl::InfiniteFuture()) const;

  // Meters the frame without rendering it. Ignores the frame's `on_sent`, `verify` and `error_map`.
  absl::StatusOr<v1::MeterResponse> meter(const v1::Settings& settings, const FrameView& frame,
                                          absl::Time deadline = absl::InfiniteFuture()) const;

  // Puts the panorama on the server, unless it is there.
  absl::StatusOr<v1::Environment> put_environment(const Panorama& panorama,
                                                  absl::Time deadline = absl::InfiniteFuture()) const;

  // The environment with this id. NOT_FOUND, as for the other calls about environments, if the server does
  // not have it.
  absl::StatusOr<v1::Environment> get_environment(const std::string& id,
                                                  absl::Time deadline = absl::InfiniteFuture()) const;

  // The cube map and the specular levels that `request` asks for.
  absl::StatusOr<EnvironmentBake> bake_environment(const v1::BakeEnvironmentRequest& request,
                                                   absl::Time deadline = absl::InfiniteFuture()) const;

  // Frees the environment as soon as nothing uses it.
  absl::StatusOr<v1::DropEnvironmentResponse> drop_environment(
      const std::string& id, absl::Time deadline = absl::InfiniteFuture()) const;

  // The server's version, device, limits, formats and tiers.
  absl::StatusOr<v1::GetServerInfoResponse> server_info(absl::Time deadline = absl::InfiniteFuture()) const;

  // OK if the server says SERVING. UNAVAILABLE if it says anything else or cannot be reached.
  absl::Status health(absl::Time deadline = absl::InfiniteFuture()) const;

  // The address given to open(), or "this process" for a channel.
  const std::string& address() const { return peer_.address; }
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  std::shared_ptr<grpc::Channel> channel_;
  Peer peer_;
};

}  // namespace candela
