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
  header.set_format(frame.format);
  header.set_total_bytes(frame.pixels.size());
  if (frame.exposure) header.set_exposure(*frame.exposure);
  request.mutable_start()->set_verify(frame.verify);
  request.mutable_start()->set_error_map(frame.error_map);
  return v1::pack(request);
}

// Copies each band, because gRPC may keep a message after its call has ended.
bool send_bands(RawCall& call, const FrameView& frame) {
  const uint64_t row_bytes = uint64_t{frame.width} * bytes_per_pixel(frame.format);
  const uint64_t rows = rows_of_band(row_bytes);
  for (uint64_t y = 0; y < frame.height; y += rows) {
    const uint64_t bytes = std::min<uint64_t>(rows, frame.height - y) * row_bytes;
    const grpc::Slice pixels(frame.pixels.data() + y * row_bytes, bytes);
    if (!call.write(v1::make_band(v1::kFrameBand, static_cast<uint32_t>(y), pixels))) return false;
  }
  return true;
}

absl::Status end_of(RawCall& call, const Peer& peer) {
  const grpc::Status status = call.finish();
  return from_grpc(status, peer, call.connected());
}

template <typename Response>
absl::StatusOr<Response> ask(RawCall& call, const google::protobuf::Message& request, const Peer& peer) {
  grpc::ByteBuffer message;
  const bool answered = call.write(v1::pack(request)) && call.half_close() && call.read(message);
  if (absl::Status status = end_of(call, peer); !status.ok()) return status;
  Response response;
  if (!answered || !v1::unpack(message, response)) return not_the_protocol("it cannot be read");
  return response;
}

}  // namespace

absl::StatusOr<Connection> Connection::open(const std::string& address, const ClientSecurity& security) {
  Peer peer{address, security};
  absl::StatusOr<std::shared_ptr<grpc::Channel>> channel = open_channel(peer);
  if (!channel.ok()) return channel.status();
  return Connection(*std::move(channel), std::move(peer));
}

Connection::Connection(std::shared_ptr<grpc::Channel> channel)
    : Connection(std::move(channel), Peer{"this process"}) {}

Connection::Connection(std::shared_ptr<grpc::Channel> channel, Peer peer)
    : channel_(std::move(channel)), peer_(std::move(peer)) {}

absl::StatusOr<RenderResult> Connection::render(const v1::Settings& settings, const FrameView& frame,
                                                absl::Time deadline) const {
  if (absl::Status status = check_frame(frame.width, frame.height, frame.format, frame.pixels.size());
      !status.ok()) {
    return status;
  }
  RawCall call(channel_, "/candela.v1.RenderService/Render", deadline);
  grpc::ByteBuffer message;
  const bool sent =
      call.write(start_message(settings, frame)) && send_bands(call, frame) && call.half_close();
  if (sent && frame.on_sent) frame.on_sent();
  if (!sent || !call.read(message)) {
    const absl::Status status = end_of(call, peer_);
    return status.ok() ? not_the_protocol("it ended before its header") : status;
  }
  ResultReader reader({frame.width, frame.height, frame.verify, frame.error_map, frame.exposure});
  do {
    if (absl::Status status = reader.read(message); !status.ok()) return status;
  } while (call.read(message));
  if (absl::Status status = end_of(call, peer_); !status.ok()) return status;
  return reader.take();
}

absl::StatusOr<v1::MeterResponse> Connection::meter(const v1::Settings& settings, const FrameView& frame,
                                                    absl::Time deadline) const {
  if (absl::Status status = check_frame(frame.width, frame.height, frame.format, frame.pixels.size());
      !status.ok()) {
    return status;
  }
  RawCall call(channel_, "/candela.v1.RenderService/Meter", deadline);
  grpc::ByteBuffer message;
  const bool answered = call.write(start_message(settings, frame)) && send_bands(call, frame) &&
                        call.half_close() && call.read(message);
  if (absl::Status status = end_of(call, peer_); !status.ok()) return status;
  v1::MeterResponse response;
  if (!answered || !v1::unpack(message, response)) return not_the_protocol("it cannot be read");
  return response;
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
  const absl::StatusOr<google::protobuf::Int32Value> status =
      ask<google::protobuf::Int32Value>(call, google::protobuf::StringValue(), peer_);
  if (!status.ok()) return status.status();
  if (status->value() == kServing) return absl::OkStatus();
  return absl::UnavailableError(absl::StrFormat(
      "the server at %s is up but not serving: it is starting or draining; try again or use another one",
      peer_.address));
}

}  // namespace candela
