#include "client/connection.h"

#include <google/protobuf/wrappers.pb.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/call/raw_call.h"
#include "client/call/result_reader.h"
#include "client/call/wire.h"
#include "proto/candela/v1/band_wire.h"
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

}  // namespace candela
