#include "client/connection.h"

#include <google/protobuf/wrappers.pb.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/call/channel.h"
#include "client/call/raw_call.h"
#include "client/call/result_reader.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

grpc::ByteBuffer start_message(const v1::Settings& settings, const FrameView& frame) {
  v1::RenderRequest request;
  *request.mutable_start()->mutable_settings() = settings;
  if (frame.previous) *request.mutable_start()->mutable_previous() = *frame.previous;
  v1::FrameHeader& header = *request.mutable_start()->mutable_frame();
  header.set_sequence(frame.sequence);
  header.set_width(frame.width);
  header.set_height(frame.height);
  if (frame.view) {
    *header.mutable_view() = *frame.view;
  } else {
    header.set_format(frame.format);
    header.set_total_bytes(frame.pixels.size());
  }
  if (frame.exposure) header.set_exposure(*frame.exposure);
  request.mutable_start()->set_verify(frame.verify);
  request.mutable_start()->set_error_map(frame.error_map);
  return v1::pack(request);
}

absl::Status check_whole(const FrameView& frame) {
  if (frame.view) return check_view(frame.width, frame.height, frame.pixels.size());
  return check_frame(frame.width, frame.height, frame.format, frame.pixels.size());
}

bool send_bands(RawCall& call, const FrameView& frame) {
  if (frame.view) return true;
  const uint64_t row_bytes = uint64_t{frame.width} * bytes_per_pixel(frame.format);
  return send_bands(call, v1::kFrameBand, row_bytes, frame.pixels);
}

}  // namespace

absl::StatusOr<Connection> Connection::open(const std::string& address, const ClientSecurity& security) {
  Peer peer{address, security};
  ASSIGN_OR_RETURN(std::shared_ptr<grpc::Channel> channel, open_channel(peer));
  return Connection(std::move(channel), std::move(peer));
}

Connection::Connection(std::shared_ptr<grpc::Channel> channel)
    : Connection(std::move(channel), Peer{"this process"}) {}

Connection::Connection(std::shared_ptr<grpc::Channel> channel, Peer peer)
    : channel_(std::move(channel)), peer_(std::move(peer)) {}

absl::StatusOr<RenderResult> Connection::render(const v1::Settings& settings, const FrameView& frame,
                                                absl::Time deadline) const {
  RETURN_IF_ERROR(check_whole(frame));
  RawCall call(channel_, "/candela.v1.RenderService/Render", deadline);
  grpc::ByteBuffer message;
  const bool sent =
      call.write(start_message(settings, frame)) && send_bands(call, frame) && call.half_close();
  if (sent && frame.on_sent) frame.on_sent();
  if (!sent || !call.read(message)) {
    const absl::Status status = end_of(call, peer_);
    return status.ok() ? not_the_protocol("it ended before its header") : status;
  }
  const v1::ImageSize image = v1::image_size(settings.output_size(), {frame.width, frame.height});
  ResultReader reader({{frame.width, frame.height}, image, frame.verify, frame.error_map, frame.exposure});
  do {
    RETURN_IF_ERROR(reader.read(message));
  } while (call.read(message));
  RETURN_IF_ERROR(end_of(call, peer_));
  return reader.take();
}

absl::StatusOr<v1::MeterResponse> Connection::meter(const v1::Settings& settings, const FrameView& frame,
                                                    absl::Time deadline) const {
  RETURN_IF_ERROR(check_whole(frame));
  RawCall call(channel_, "/candela.v1.RenderService/Meter", deadline);
  grpc::ByteBuffer message;
  const bool answered = call.write(start_message(settings, frame)) && send_bands(call, frame) &&
                        call.half_close() && call.read(message);
  return answer_of<v1::MeterResponse>(call, answered, message, peer_);
}

absl::StatusOr<v1::GetServerInfoResponse> Connection::server_info(absl::Time deadline) const {
  RawCall call(channel_, "/candela.v1.RenderService/GetServerInfo", deadline);
  return ask<v1::GetServerInfoResponse>(call, v1::GetServerInfoRequest(), peer_);
}

absl::Status Connection::health(absl::Time deadline) const {
  // These wrappers have the same encoding as grpc.health.v1's request (string service = 1) and response (enum
  // status = 1).
  constexpr int kServing = 1;
  RawCall call(channel_, "/grpc.health.v1.Health/Check", deadline);
  ASSIGN_OR_RETURN(const google::protobuf::Int32Value status,
                   ask<google::protobuf::Int32Value>(call, google::protobuf::StringValue(), peer_));
  if (status.value() == kServing) return absl::OkStatus();
  return absl::UnavailableError(absl::StrFormat(
      "the server at %s is up but not serving: it is starting or draining; try again or use another one",
      peer_.address));
}

namespace {

constexpr uint32_t kFaces = 6;

absl::StatusOr<v1::Environment> upload(const std::shared_ptr<grpc::Channel>& channel, const Peer& peer,
                                       const Panorama& panorama, absl::Time deadline) {
  RawCall call(channel, "/candela.v1.RenderService/PutEnvironment", deadline);
  v1::PutEnvironmentRequest request;
  *request.mutable_start() = panorama.start;
  request.mutable_start()->set_total_bytes(panorama.pixels.size());
  const uint64_t row_bytes = uint64_t{panorama.start.width()} * bytes_per_pixel(panorama.start.format());
  grpc::ByteBuffer message;
  const bool answered = call.write(v1::pack(request)) &&
                        send_bands(call, v1::kPanoramaBand, row_bytes, panorama.pixels) &&
                        call.half_close() && call.read(message);
  return answer_of<v1::Environment>(call, answered, message, peer);
}

// Reads one bake, message by message.
class BakeReader {
 public:
  explicit BakeReader(v1::PixelFormat format) { baked_.format = format; }

  absl::Status read(grpc::ByteBuffer& message) {
    if (!faces_.empty() && !bands_.whole()) return bands_.take(message);
    v1::BakeEnvironmentResponse response;
    if (!v1::unpack(message, response)) return not_the_protocol("it cannot be read");
    if (response.has_header() && baked_.levels.empty()) return take_header(response.header());
    if (response.has_face() && !baked_.levels.empty()) return take_face(response.face());
    return not_the_protocol("a message of a bake is out of place");
  }

  absl::StatusOr<EnvironmentBake> take() {
    if (baked_.levels.empty() || faces_.size() != baked_.levels.size() * kFaces || !bands_.whole()) {
      return not_the_protocol("it ended before the last face");
    }
    return std::move(baked_);
  }

 private:
  absl::Status take_header(const v1::BakeHeader& header) {
    uint32_t size = header.size();
    if (size > v1::kCubeSize.max) return not_the_protocol("the size of a bake");
    for (const v1::BakedLevel& level : header.levels()) {
      if (size == 0 || level.size() != size) return not_the_protocol("the size of a bake's level");
      baked_.levels.emplace_back(face_bytes(level) * kFaces);
      size /= 2;
    }
    baked_.header = header;
    return baked_.levels.empty() ? not_the_protocol("a bake without levels") : absl::OkStatus();
  }

  absl::Status take_face(const v1::BakeFace& face) {
    const auto next = static_cast<uint32_t>(faces_.size());
    if (face.level() != next / kFaces || face.face() != next % kFaces ||
        face.level() >= baked_.levels.size()) {
      return not_the_protocol("its faces are out of order");
    }
    const v1::BakedLevel& level = baked_.header.levels(static_cast<int>(face.level()));
    std::vector<std::byte>& bytes = baked_.levels[face.level()];
    bands_.begin(std::span(bytes).subspan(face.face() * face_bytes(level), face_bytes(level)),
                 row_bytes(level));
    faces_.push_back(face);
    return absl::OkStatus();
  }

  uint64_t row_bytes(const v1::BakedLevel& level) const {
    return uint64_t{level.size()} * bytes_per_pixel(baked_.format);
  }
  uint64_t face_bytes(const v1::BakedLevel& level) const { return row_bytes(level) * level.size(); }

  EnvironmentBake baked_;
  std::vector<v1::BakeFace> faces_;  // that have begun
  IncomingBands bands_{v1::kBakeBand};
};

}  // namespace

absl::StatusOr<v1::Environment> Connection::put_environment(const Panorama& panorama,
                                                            absl::Time deadline) const {
  RETURN_IF_ERROR(check_panorama(panorama));
  absl::StatusOr<v1::Environment> known = get_environment(environment_id(panorama), deadline);
  if (!absl::IsNotFound(known.status())) return known;
  return upload(channel_, peer_, panorama, deadline);
}

absl::StatusOr<v1::Environment> Connection::get_environment(const std::string& id,
                                                            absl::Time deadline) const {
  RawCall call(channel_, "/candela.v1.RenderService/GetEnvironment", deadline);
  v1::GetEnvironmentRequest request;
  request.set_id(id);
  return ask<v1::Environment>(call, request, peer_);
}

absl::StatusOr<EnvironmentBake> Connection::bake_environment(const v1::BakeEnvironmentRequest& request,
                                                             absl::Time deadline) const {
  RawCall call(channel_, "/candela.v1.RenderService/BakeEnvironment", deadline);
  BakeReader reader(request.format());
  grpc::ByteBuffer message;
  const bool sent = call.write(v1::pack(request)) && call.half_close();
  while (sent && call.read(message)) {
    RETURN_IF_ERROR(reader.read(message));
  }
  RETURN_IF_ERROR(end_of(call, peer_));
  return reader.take();
}

absl::StatusOr<v1::DropEnvironmentResponse> Connection::drop_environment(const std::string& id,
                                                                         absl::Time deadline) const {
  RawCall call(channel_, "/candela.v1.RenderService/DropEnvironment", deadline);
  v1::DropEnvironmentRequest request;
  request.set_id(id);
  return ask<v1::DropEnvironmentResponse>(call, request, peer_);
}

}  // namespace candela
